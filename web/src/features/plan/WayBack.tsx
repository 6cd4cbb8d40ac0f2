// The way back from where the step stands: the same path backward, staged part by part like the rest.

import { Undo2 } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { planProgress } from "../../lib/planProgress";
import { wayBack } from "../../lib/planWords";
import { formatSpan } from "../../lib/time";
import { planKey, stagePlanned, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useBlocked } from "../../store/permission";
import { CommandRow } from "../commands/PlanCommands";

export function WayBack({ plan }: { plan: PlanAnswer }) {
  const commands = useLive((c) => c.commands);
  const progress = planProgress(plan, commands);
  const { done, back, turned, underWay } = progress;
  const begun = back.findIndex((r) => r?.state === "done");
  const next = plan.commands.length - done;
  const first = turned && begun >= 0 ? begun : next;
  const parts = wayBack(plan, plan.commands.length - first);
  if (parts.length === 0) return null;
  const whole_s = wayBack(plan, done).reduce((sum, c) => sum + c.duration_s, 0);
  return (
    <section className="section way-back" data-testid="way-back" aria-label="Way back">
      <div className="row between">
        <span>
          Way back <span className="quiet small num">{formatSpan(whole_s)}</span>
        </span>
        {!turned && <BackOut plan={plan} index={next} underWay={underWay} />}
      </div>
      {turned && (
        <ol className="commands">
          {parts.map((command, i) => {
            const index = first + i;
            const early = index > next ? "The part before this one is not done" : null;
            return (
              <CommandRow
                key={index}
                of={{ plan_id: plan.id, index, retreat: true }}
                command={command}
                record={back[index]}
                why={underWay ? UNDER_WAY : early}
              />
            );
          })}
        </ol>
      )}
    </section>
  );
}

const UNDER_WAY = "A command of the plan is under way";

/** Stages the part that undoes the last command that is done. */
function BackOut(props: { plan: PlanAnswer; index: number; underWay: boolean }) {
  const { plan, index, underWay } = props;
  const of = { plan_id: plan.id, index, retreat: true };
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy[planKey(of)]);
  const failure = useRequests((s) => s.failures[planKey(of)]);
  const why = blocked ?? (underWay ? UNDER_WAY : null);
  return (
    <>
      {failure && (
        <span className="trouble small" role="alert">
          {failure}
        </span>
      )}
      <button
        type="button"
        className="button"
        data-testid="back-out"
        disabled={why !== null || busy}
        title={why ?? "Stage the way back of the last command; the plan then goes back only"}
        onClick={() => void stagePlanned(of)}
      >
        <Undo2 size={14} aria-hidden />
        Back out
      </button>
    </>
  );
}
