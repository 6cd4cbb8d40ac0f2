// The way back from where the step stands: the same path backward. Information only, it is not staged.

import { ChevronRight } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { readable } from "../../lib/format";
import { wayBack } from "../../lib/planWords";
import { formatSpan } from "../../lib/time";
import { ofPlan } from "../../store/commands";
import { useLive } from "../../store/console";

export function WayBack({ plan }: { plan: PlanAnswer }) {
  const commands = useLive((c) => c.commands);
  const records = ofPlan(commands, plan.id, plan.commands.length);
  const done = records.findLastIndex((r) => r?.state === "done") + 1;
  const back = wayBack(plan, done);
  if (done === 0 || done === plan.commands.length || back.length === 0) return null;
  const whole_s = back.reduce((sum, c) => sum + c.duration_s, 0);
  return (
    <details className="section way-back" data-testid="way-back">
      <summary className="options-head">
        <ChevronRight size={14} aria-hidden />
        Way back
        <span className="quiet num">{formatSpan(whole_s)}</span>
      </summary>
      <p className="quiet small">What would undo the commands that are done; nothing is staged.</p>
      <ol>
        {back.map((command, i) => (
          <li key={i} className="row between">
            {readable(command.title)}
            <span className="quiet num">{formatSpan(command.duration_s)}</span>
          </li>
        ))}
      </ol>
    </details>
  );
}
