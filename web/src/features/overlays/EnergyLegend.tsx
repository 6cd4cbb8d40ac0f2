// The scale of the energy surface, with the rover's own place on it.

import { metres, signless } from "../../lib/format";
import { joules } from "../../lib/margins";
import { cividis, contourStep } from "../../lib/energySheet";
import { useEnergy } from "../../store/energy";

const STOPS = 9;
const W = 208;

const css = (share: number) => `rgb(${cividis(share).map((c) => Math.round(255 * c))})`;

export function EnergyLegend() {
  const { surface, state, failure } = useEnergy();
  return (
    <div className="stack" data-testid="energy-legend" data-state={state}>
      <p className="small quiet">
        Rise of the center of mass (m) that would tip the rover, were it over each place.
      </p>
      {surface && <Scale most_m={surface.most_m} margin_m={surface.margin_m} />}
      {surface && (
        <p className="row between small">
          <span className="quiet">center of mass</span>
          <span className="num" data-testid="energy-own">
            {metres(surface.margin_m)}
            {surface.margin_j !== null && ` · ${joules(surface.margin_j)}`}
          </span>
        </p>
      )}
      {!surface && (
        <p className="small quiet" role="status">
          {state === "loading" && "Computing…"}
          {state === "none" && "No support polygon is known."}
          {state === "failed" && <span className="trouble">{failure}</span>}
        </p>
      )}
    </div>
  );
}

function Scale({ most_m, margin_m }: { most_m: number; margin_m: number | null }) {
  const step = contourStep(most_m);
  const lines = Array.from({ length: Math.floor(most_m / step) + 1 }, (_, i) => i * step);
  const x = (m: number) => 4 + (W - 8) * Math.min(1, Math.max(0, m / most_m));
  const decimals = step < 0.1 ? 2 : 1;
  return (
    <svg
      className="energy-scale"
      viewBox={`0 0 ${W} 26`}
      role="img"
      aria-label={`From 0 to ${metres(most_m)}, lines each ${metres(step)}`}
    >
      <defs>
        <linearGradient id="energy-scale">
          {Array.from({ length: STOPS }, (_, i) => (
            <stop key={i} offset={i / (STOPS - 1)} stopColor={css(i / (STOPS - 1))} />
          ))}
        </linearGradient>
      </defs>
      <rect x="4" y="5" width={W - 8} height="7" rx="2" fill="url(#energy-scale)" />
      {lines.map((m, i) => (
        <g key={m}>
          {i > 0 && <path d={`M${x(m)} 5v7`} stroke="#f4f7fa" strokeOpacity="0.7" />}
          {i % 2 === 0 && (
            <text className="strip-text" x={x(m)} y="23" textAnchor={i === 0 ? "start" : "middle"}>
              {signless(m, decimals)}
            </text>
          )}
        </g>
      ))}
      {margin_m !== null && (
        <path
          d={`M${x(margin_m)} 14l-4 -12h8z`}
          fill="var(--text)"
          stroke="var(--surface-1)"
          strokeWidth="1"
        />
      )}
    </svg>
  );
}
