// The preview: a scrubber over the planned step, with the margin of stability along it.

import { Pause, Play } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { metres, newtons } from "../../lib/format";
import { phaseName, phaseSpans } from "../../lib/planWords";
import { formatSpan } from "../../lib/time";
import { useConsole } from "../../store/console";
import { planDuration, scrubTo, stopPlaying, togglePlaying, usePlan } from "../../store/plan";

/** Whole steps, so that the last of them is the very end. */
const SCRUB_STEPS = 200;

export function Preview({ plan }: { plan: PlanAnswer }) {
  const { at_s, playing } = usePlan();
  const length = planDuration(plan);
  const at = plan.waypoints.find((w) => w.time_s >= at_s - 1e-6)?.phase;
  const phase = at === undefined ? "" : phaseName(at);
  return (
    <section className="section stack" aria-label="Preview">
      <div className="row">
        <button
          type="button"
          className="button icon"
          data-testid="preview-play"
          aria-label={playing ? "Hold the preview" : "Play the preview"}
          title={playing ? "Hold (p)" : "Play (p)"}
          onClick={togglePlaying}
        >
          {playing ? <Pause size={16} /> : <Play size={16} />}
        </button>
        <div className="preview-scrub">
          <input
            type="range"
            data-testid="preview-scrub"
            aria-label="Place in the preview"
            aria-valuetext={`${formatSpan(at_s)}, ${phase}`}
            min={0}
            max={SCRUB_STEPS}
            value={length > 0 ? Math.round((at_s / length) * SCRUB_STEPS) : 0}
            onChange={(event) => {
              stopPlaying();
              scrubTo((Number(event.target.value) / SCRUB_STEPS) * length);
            }}
          />
          <Phases plan={plan} length={length} at_s={at_s} />
          <MarginStrip plan={plan} length={length} at_s={at_s} />
        </div>
      </div>
      <div className="row between small">
        <span className="quiet">
          {phase}
          {at === "preload" && plan.preload_n != null && ` to ${newtons(plan.preload_n)}`}
        </span>
        <span className="num">
          {formatSpan(at_s)} / {formatSpan(length)}
        </span>
      </div>
    </section>
  );
}

/** The parts of the step by length, and where the rover may be held as long as one likes. */
function Phases({ plan, length, at_s }: { plan: PlanAnswer; length: number; at_s: number }) {
  if (length <= 0) return null;
  const holds = plan.waypoints.filter((w) => w.hold);
  const share = (t: number) => `${((100 * t) / length).toFixed(2)}%`;
  return (
    <div className="phases" data-testid="phases" aria-hidden>
      <div className="holds" title="Marked: where the rover can be held">
        {holds.map((w, i) => (
          <i key={i} style={{ left: share(w.time_s) }} />
        ))}
      </div>
      {phaseSpans(plan.waypoints).map(({ phase, from_s, to_s }) => (
        <span
          key={from_s}
          className={at_s > from_s && at_s <= to_s ? "phase now" : "phase"}
          title={phaseName(phase)}
          style={{ left: share(from_s), width: share(to_s - from_s) }}
        />
      ))}
    </div>
  );
}

const [W, H] = [220, 34];

/** Margin against time, its least value marked and what the rule asks for as a line. */
function MarginStrip({ plan, length, at_s }: { plan: PlanAnswer; length: number; at_s: number }) {
  const needed = useConsole((s) => s.model?.margin_m ?? 0);
  const { time_s, regular_m } = plan.margins;
  const samples = time_s.flatMap((time_s, i) => {
    const margin_m = regular_m[i];
    return margin_m == null ? [] : [{ time_s, margin_m }];
  });
  if (samples.length < 2 || length <= 0) return null;
  const most = Math.max(needed * 1.5, ...samples.map((m) => m.margin_m));
  const least = samples.reduce((a, b) => (b.margin_m < a.margin_m ? b : a));
  const low = Math.min(0, least.margin_m);
  const x = (t: number) => (t / length) * W;
  const y = (m: number) => H - 2 - ((m - low) / (most - low)) * (H - 6);
  const path = samples
    .map((m) => `${x(m.time_s).toFixed(1)} ${y(m.margin_m).toFixed(1)}`)
    .join("L");
  const short = least.margin_m < needed;
  return (
    <div className="margin-strip">
      <svg
        viewBox={`0 0 ${W} ${H}`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`Margin along the step, least ${metres(least.margin_m)}`}
      >
        <path d={`M${path}L${W} ${H}L0 ${H}Z`} fill="var(--text-2)" opacity="0.16" />
        <path
          d={`M${path}`}
          fill="none"
          stroke="var(--text-2)"
          strokeWidth="1.4"
          vectorEffect="non-scaling-stroke"
        />
        <path
          d={`M0 ${y(needed)}H${W}`}
          stroke="var(--serious)"
          strokeDasharray="3 3"
          strokeWidth="1"
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
      <div className="row between small">
        <span className="quiet">margin, least</span>
        <span className="num" data-testid="least-margin">
          {metres(least.margin_m)} at {formatSpan(least.time_s)}
        </span>
      </div>
    </div>
  );
}
