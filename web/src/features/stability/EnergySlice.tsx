// The rise of the center of mass that would tip the rover, were it farther along a heading.

import { useEffect } from "react";

import type { EnergySlice as Slice } from "../../api/types";
import { metres, signless } from "../../lib/format";
import { headingWords, roundUp, slicePoints } from "../../lib/slice";
import { startSlice, useSlice } from "../../store/slice";

const [W, H] = [280, 88];
const LEFT = 30;
const RIGHT = 4;
const TOP = 6;
const BOTTOM = 20;
const STEP_DEG = 5;

export function EnergySlice() {
  useEffect(startSlice, []);
  const { heading_rad, slice, state, failure } = useSlice();
  const degrees = Math.round((heading_rad * 180) / Math.PI);
  return (
    <section className="section energy-slice of-rover" aria-label="Energy along a heading">
      <div className="row between">
        <h2>Energy to tip, going</h2>
        <span className="num small" data-testid="slice-heading">
          {headingWords(heading_rad)}
        </span>
      </div>
      {slice ? (
        <Plot slice={slice} />
      ) : (
        <p className="quiet small slice-none" role="status">
          {state === "failed" ? (
            <span className="trouble">{failure}</span>
          ) : state === "loading" ? (
            "Computing…"
          ) : (
            "No support polygon is known."
          )}
        </p>
      )}
      <div className="slice-control">
        <span className="quiet small">left</span>
        <input
          type="range"
          data-testid="slice-control"
          aria-label="Heading from the rover's forward"
          aria-valuetext={headingWords(heading_rad)}
          min={-180}
          max={180}
          step={STEP_DEG}
          // To the left is positive; on screen left is left.
          value={-degrees}
          onChange={(event) =>
            useSlice.setState({ heading_rad: (-Number(event.target.value) * Math.PI) / 180 })
          }
          onDoubleClick={() => useSlice.setState({ heading_rad: 0 })}
        />
        <span className="quiet small">right</span>
      </div>
    </section>
  );
}

function Plot({ slice }: { slice: Slice }) {
  const points = slicePoints(slice);
  const here = points[0]?.rise_m ?? 0;
  const most = roundUp(Math.max(0.01, ...points.map((p) => p.rise_m)));
  const ends = points.at(-1)?.at_m ?? 0;
  const far = Math.max(ends, 1e-6);
  const x = (m: number) => LEFT + (m / far) * (W - LEFT - RIGHT);
  const y = (m: number) => TOP + (1 - m / most) * (H - TOP - BOTTOM);
  const path = points.map((p) => `${x(p.at_m).toFixed(1)} ${y(p.rise_m).toFixed(1)}`).join("L");
  const decimals = most < 0.2 ? 2 : 1;
  if (points.length < 2) return <p className="small">The rover tips by itself.</p>;
  return (
    <svg
      className="slice-plot"
      viewBox={`0 0 ${W} ${H}`}
      role="img"
      data-testid="slice-plot"
      aria-label={`Rise to tip: ${metres(here)} here, none after ${metres(ends)}`}
    >
      {[0, most].map((m) => (
        <g key={m}>
          <path d={`M${LEFT} ${y(m)}H${W - RIGHT}`} stroke="var(--line)" />
          <text className="strip-text" x={LEFT - 4} y={y(m) + 3} textAnchor="end">
            {signless(m, decimals)}
          </text>
        </g>
      ))}
      <path d={`M${path}L${x(far)} ${y(0)}L${x(0)} ${y(0)}Z`} fill="var(--text-2)" opacity="0.14" />
      <path d={`M${path}`} fill="none" stroke="var(--text)" strokeWidth="1.5" />
      <circle cx={x(0)} cy={y(here)} r="2.8" fill="var(--text)" />
      <text className="strip-text" x={x(0) + 7} y={y(here) - 3} textAnchor="start">
        {metres(here)} here
      </text>
      <text className="strip-text" x={LEFT} y={H - 5} textAnchor="start">
        center of mass
      </text>
      <text className="strip-text" x={W - RIGHT} y={H - 5} textAnchor="end">
        tips after {metres(ends)}
      </text>
    </svg>
  );
}
