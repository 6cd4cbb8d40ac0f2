// The way back from where the step stands: the same path backward. Information only, it is not staged.

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
      <summary>
        Way back <span className="quiet small num">{formatSpan(whole_s)}</span>
      </summary>
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
