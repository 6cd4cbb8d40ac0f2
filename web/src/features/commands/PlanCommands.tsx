// The commands of a plan, one for each phase: staged and armed here, sent from the strip below.

import type { CommandRecord, PlanAnswer, PlanCommand } from "../../api/types";
import { commandClock } from "../../lib/commandClock";
import { readable } from "../../lib/format";
import { formatSpan } from "../../lib/time";
import { arm, ofPlan, planKey, stagePlanned, takeBack, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { useBlocked } from "../../store/permission";
import { CommandMark } from "./CommandMark";
import "./commands.css";

export function PlanCommands({ plan }: { plan: PlanAnswer }) {
  const commands = useLive((c) => c.commands);
  const records = ofPlan(commands, plan.id, plan.commands.length);
  return (
    <section className="section" aria-label="Commands of the plan">
      <ol className="commands">
        {plan.commands.map((command, index) => {
          const before = records.slice(0, index).every((r) => r?.state === "done");
          return (
            <Row
              key={index}
              plan_id={plan.id}
              index={index}
              command={command}
              record={records[index]}
              ready={before}
            />
          );
        })}
      </ol>
    </section>
  );
}

interface RowProps {
  plan_id: string;
  index: number;
  command: PlanCommand;
  record: CommandRecord | undefined;
  /** All commands before this one are done. */
  ready: boolean;
}

function Row({ plan_id, index, command, record, ready }: RowProps) {
  const now = useServerNow();
  const ref = { plan_id, index };
  const failures = useRequests((s) => s.failures);
  const failure = failures[record?.id ?? ""] ?? failures[planKey(ref)];
  const clock = record && commandClock(record, now);
  return (
    <li
      className="command"
      data-testid={`command-${index}`}
      data-state={record?.state ?? "planned"}
    >
      <CommandMark state={record?.state ?? null} />
      <div className="command-text">
        <span>{readable(command.title)}</span>
        <span className="quiet small">
          <span data-testid={`state-${index}`}>{clock?.word ?? "planned"}</span>
          {clock?.waits ? (
            <span className="command-waits">{clock.waits}</span>
          ) : (
            <span className="num">{formatSpan(command.duration_s)}</span>
          )}
        </span>
        {record?.why && <span className="trouble small">{readable(record.why)}</span>}
        {failure && (
          <span className="trouble small" role="alert">
            {failure}
          </span>
        )}
      </div>
      <Actions refToPlan={ref} record={record} ready={ready} lapsed={clock?.armed_s === 0} />
    </li>
  );
}

interface ActionProps {
  refToPlan: { plan_id: string; index: number };
  record: CommandRecord | undefined;
  ready: boolean;
  lapsed: boolean;
}

const AGAIN = new Set(["failed", "aborted", "cancelled", "expired"]);

function Actions({ refToPlan, record, ready, lapsed }: ActionProps) {
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy);
  const key = planKey(refToPlan);
  const { index } = refToPlan;
  if (!record || AGAIN.has(record.state)) {
    const why = blocked ?? (ready ? null : "The command before this one is not done");
    return (
      <button
        type="button"
        className={why === null ? "button primary" : "button"}
        data-testid={`stage-${index}`}
        disabled={why !== null || busy[key]}
        title={why ?? "Stage this command"}
        onClick={() => void stagePlanned(refToPlan)}
      >
        Stage
      </button>
    );
  }
  if (record.state === "staged" || (record.state === "armed" && lapsed)) {
    return (
      <span className="row command-actions">
        <button
          type="button"
          className="button bare"
          data-testid={`cancel-${index}`}
          onClick={() => void takeBack(record.id)}
        >
          Cancel
        </button>
        <button
          type="button"
          className="button primary"
          data-testid={`arm-${index}`}
          disabled={blocked !== null || busy[record.id]}
          title={blocked ?? "Arm for 30 s; sending is done from the strip below"}
          onClick={() => void arm(record.id)}
        >
          Arm
        </button>
      </span>
    );
  }
  return null;
}
