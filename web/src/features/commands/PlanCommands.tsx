// The commands of a plan, one for each phase: staged and armed here, sent from the strip below.

import type { CommandRecord, PlanAnswer, PlanCommand, PlanCommandRef } from "../../api/types";
import { commandClock } from "../../lib/commandClock";
import { readable } from "../../lib/format";
import { planProgress } from "../../lib/planProgress";
import { formatSpan } from "../../lib/time";
import { commandName, planKey, stagePlanned, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { useBlocked } from "../../store/permission";
import { AddToSequence } from "../sequence/AddToSequence";
import { NextConditions } from "../conditions/NextConditions";
import { ApprovalLine, ArmActions } from "./ArmActions";
import { CommandMark } from "./CommandMark";
import { wayOn } from "../../lib/commandClock";
import "./commands.css";

export function PlanCommands({ plan }: { plan: PlanAnswer }) {
  const commands = useLive((c) => c.commands);
  const { forward, done, turned } = planProgress(plan, commands);
  return (
    <section className="section" aria-label="Commands of the plan">
      <ol className="commands">
        {plan.commands.map((command, index) => {
          const why = index > done ? "The command before this one is not done" : null;
          return (
            <CommandRow
              key={index}
              of={{ plan_id: plan.id, index, retreat: false }}
              command={command}
              record={forward[index]}
              why={turned ? "The plan is being backed out" : why}
            />
          );
        })}
      </ol>
      {!turned && done < plan.commands.length && <NextConditions of="plan" />}
      {done === 0 && !turned && <AddToSequence plan={plan} />}
    </section>
  );
}

interface RowProps {
  of: PlanCommandRef;
  command: PlanCommand;
  record: CommandRecord | undefined;
  /** Why it cannot be staged now, or null. */
  why: string | null;
}

/** A command of a plan, or a part of its way back. */
export function CommandRow({ of, command, record, why }: RowProps) {
  const now = useServerNow();
  const name = commandName(of);
  const failures = useRequests((s) => s.failures);
  const failure = failures[record?.id ?? ""] ?? failures[planKey(of)];
  const clock = record && commandClock(record, now);
  return (
    <li className="command" data-testid={`command-${name}`} data-state={record?.state ?? "planned"}>
      <CommandMark state={record?.state ?? null} />
      <div className="command-text">
        <span>{readable(command.title)}</span>
        <span className="quiet small">
          <span data-testid={`state-${name}`}>{clock?.word ?? "planned"}</span>
          {clock?.waits ? (
            <span className="command-waits">{clock.waits}</span>
          ) : (
            <span className="num">{formatSpan(command.duration_s)}</span>
          )}
        </span>
        {record && <ApprovalLine command={record} />}
        {record?.why && <span className="trouble small">{readable(record.why)}</span>}
        {record && wayOn(record) && <span className="quiet small">{wayOn(record)}</span>}
        {failure && (
          <span className="trouble small" role="alert">
            {failure}
          </span>
        )}
      </div>
      <Actions of={of} record={record} why={why} lapsed={clock?.armed_s === 0} />
    </li>
  );
}

interface ActionProps {
  of: PlanCommandRef;
  record: CommandRecord | undefined;
  why: string | null;
  lapsed: boolean;
}

const AGAIN = new Set(["failed", "aborted", "cancelled", "expired"]);

function Actions({ of, record, why: early, lapsed }: ActionProps) {
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy);
  const key = planKey(of);
  const name = commandName(of);
  if (!record || AGAIN.has(record.state)) {
    const why = blocked ?? early;
    return (
      <button
        type="button"
        className={why === null ? "button primary" : "button"}
        data-testid={`stage-${name}`}
        disabled={why !== null || busy[key]}
        title={why ?? "Stage this command"}
        onClick={() => void stagePlanned(of)}
      >
        Stage
      </button>
    );
  }
  if (record.state === "staged" || (record.state === "armed" && lapsed)) {
    return <ArmActions command={record} cancelId={`cancel-${name}`} armId={`arm-${name}`} />;
  }
  return null;
}
