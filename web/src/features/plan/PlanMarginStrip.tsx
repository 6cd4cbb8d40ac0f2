// The margins along a plan under its scrubber: every kind that is told, and what holds where the ghost is.

import type { PlanAnswer } from "../../api/types";
import { metres } from "../../lib/format";
import { joules } from "../../lib/margins";
import {
  type Curve,
  CURVES,
  leastOf,
  marginsAt,
  planMargins,
  type PlanMargins,
  runsOf,
} from "../../lib/planMargins";
import { feetLabel, feetOf } from "../../lib/regions";
import { formatSpan } from "../../lib/time";
import { REGIONS } from "../../scene/palette";
import { useConsole } from "../../store/console";

const [W, H] = [220, 44];

const dashOf = (curve: Curve) => REGIONS.find((r) => r.key === curve)?.stroke ?? "";

interface Props {
  plan: PlanAnswer;
  length: number;
  at_s: number;
}

export function PlanMarginStrip({ plan, length, at_s }: Props) {
  const needed = useConsole((s) => s.model?.margin_m ?? 0);
  const margins = planMargins(plan);
  const least = margins && leastOf(margins);
  if (!margins || !least || length <= 0) return null;
  const told = CURVES.filter((curve) => margins[curve].some((m) => m !== null));
  const all = told.flatMap((curve) => margins[curve].filter((m) => m !== null));
  const most = Math.max(needed * 1.5, ...all);
  // A conservative margin can be far below zero, where its figure says enough.
  const low = Math.max(-0.5 * most, Math.min(0, ...all));
  const x = (t: number) => (t / length) * W;
  const y = (m: number) => H - 2 - ((Math.max(m, low) - low) / (most - low)) * (H - 6);
  const short = least.margin_m < needed;
  return (
    <div className="margin-strip">
      <svg
        viewBox={`0 0 ${W} ${H}`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`Margin along the step, least ${metres(least.margin_m)}`}
      >
        {low < 0 && (
          <path
            d={`M0 ${y(0)}H${W}`}
            stroke="var(--line-strong)"
            vectorEffect="non-scaling-stroke"
          />
        )}
        {told.map((curve) => (
          <Line key={curve} margins={margins} curve={curve} x={x} y={y} />
        ))}
        <path
          d={`M0 ${y(needed)}H${W}`}
          stroke="var(--serious)"
          strokeDasharray="1 3"
          strokeLinecap="round"
          vectorEffect="non-scaling-stroke"
        />
        <path
          d={`M${x(at_s)} 0V${H}`}
          stroke="var(--accent)"
          strokeWidth="1.5"
          vectorEffect="non-scaling-stroke"
        />
        <path
          d={`M${x(least.time_s)} ${y(least.margin_m)}h0.01`}
          stroke={short ? "var(--serious)" : "var(--text)"}
          strokeWidth="7"
          strokeLinecap="round"
          vectorEffect="non-scaling-stroke"
        />
      </svg>
      <Here margins={margins} told={told} at_s={at_s} />
      <div className="row between small">
        <span className="quiet">least regular</span>
        <span className="num" data-testid="least-margin">
          {metres(least.margin_m)} at {formatSpan(least.time_s)}
        </span>
      </div>
    </div>
  );
}

interface LineProps {
  margins: PlanMargins;
  curve: Curve;
  x: (t: number) => number;
  y: (m: number) => number;
}

function Line({ margins, curve, x, y }: LineProps) {
  const d = runsOf(margins, curve)
    .map((run) => `M${run.map(([t, m]) => `${x(t).toFixed(1)} ${y(m).toFixed(1)}`).join("L")}`)
    .join("");
  return (
    <path
      d={d}
      fill="none"
      stroke={`var(--series-${curve})`}
      strokeWidth={curve === "friction" ? 1.8 : 1.4}
      strokeDasharray={dashOf(curve)}
      strokeLinejoin="round"
      vectorEffect="non-scaling-stroke"
    />
  );
}

/** What holds where the ghost stands. */
function Here({ margins, told, at_s }: { margins: PlanMargins; told: Curve[]; at_s: number }) {
  const here = marginsAt(margins, at_s);
  const edge = here.critical ? feetLabel(feetOf(here.critical)) : "";
  return (
    <dl className="margins-here small" data-testid="margins-here">
      {told.map((curve) => (
        <div key={curve} title={curve === "regular" && edge ? `Decided by ${edge}` : undefined}>
          <dt>
            <svg width="18" height="8" viewBox="0 0 18 8" aria-hidden>
              <path
                d="M1 4h16"
                stroke={`var(--series-${curve})`}
                strokeWidth="2"
                strokeDasharray={dashOf(curve)}
              />
            </svg>
            {curve}
          </dt>
          <dd className="num" data-testid={`here-${curve}`}>
            {here[curve] === null ? "none" : metres(here[curve])}
          </dd>
        </div>
      ))}
      {margins.energy_m.some((m) => m !== null) && (
        <div title="Rise of the center of mass that would tip the rover, and the work">
          <dt>to tip</dt>
          <dd className="num" data-testid="here-energy">
            {metres(here.energy_m)}
            {here.energy_j !== null && ` · ${joules(here.energy_j)}`}
          </dd>
        </div>
      )}
    </dl>
  );
}
