// Taking back and arming a staged command, and the second person's word that it may wait for.

import type { CommandRecord } from "../../api/types";
import { approvalLine, approvalView } from "../../lib/approval";
import { arm, takeBack, useRequests } from "../../store/commands";
import { useServerNow } from "../../store/now";
import { useArmBlocked } from "../../store/permission";
import type { Status } from "../../store/causes";
import { StatusMark } from "../../ui/StatusMark";

interface Props {
  command: CommandRecord;
  cancelId: string;
  armId: string;
}

export function ArmActions({ command, cancelId, armId }: Props) {
  const blocked = useArmBlocked(command);
  const busy = useRequests((s) => s.busy[command.id]);
  return (
    <span className="row command-actions">
      <button
        type="button"
        className="button bare"
        data-testid={cancelId}
        onClick={() => void takeBack(command.id)}
      >
        Cancel
      </button>
      <button
        type="button"
        className="button primary"
        data-testid={armId}
        disabled={blocked !== null || busy}
        title={blocked ?? "Arm for 30 s; sending is done from the strip below"}
        onClick={() => void arm(command.id)}
      >
        Arm
      </button>
    </span>
  );
}

const MARKS: Record<string, Status> = {
  waits: "standby",
  approved: "normal",
  lapsed: "caution",
};

/** Who has approved a command that takes two persons, and for how long; nothing for others. */
export function ApprovalLine({ command }: { command: CommandRecord }) {
  const now = useServerNow();
  const line = approvalLine(command, now);
  if (line === null || !["staged", "armed"].includes(command.state)) return null;
  const { state } = approvalView(command, now);
  return (
    <span className="quiet small row" data-testid="approval" data-state={state}>
      <StatusMark status={MARKS[state] ?? "off"} />
      {line}
    </span>
  );
}
