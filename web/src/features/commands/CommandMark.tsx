import type { CommandState } from "../../api/types";
import type { Status } from "../../store/causes";
import { StatusMark } from "../../ui/StatusMark";

const MARKS: Record<CommandState, Status> = {
  staged: "standby",
  armed: "caution",
  sent: "standby",
  received: "standby",
  executing: "standby",
  done: "normal",
  failed: "critical",
  aborted: "serious",
  overdue: "serious",
  cancelled: "off",
  expired: "off",
};

export function CommandMark({ state }: { state: CommandState | null }) {
  return <StatusMark status={state === null ? "off" : MARKS[state]} label={state ?? "planned"} />;
}
