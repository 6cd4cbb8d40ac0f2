// The preview: a scrubber over the planned step, with the margin of stability along it.

import { Pause, Play } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { newtons } from "../../lib/format";
import { phaseName, phaseSpans } from "../../lib/planWords";
import { formatSpan } from "../../lib/time";
import { planDuration, scrubTo, stopPlaying, togglePlaying, usePlan } from "../../store/plan";
import { PlanMarginStrip } from "./PlanMarginStrip";

/** Whole steps, so that the last of them is the very end. */
const SCRUB_STEPS = 200;

export function Preview({ plan }: { plan: PlanAnswer }) {
  const { at_s, playing } = usePlan();
  const length = planDuration(plan);
  const at = plan.waypoints.find((w) => w.time_s >= at_s - 1e-6)?.phase;
  const phase = at === undefined ? "" : phaseName(at);
  return (
    <section className="section stack" aria-label="Preview">
      <div className="row preview-row">
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
          <PlanMarginStrip plan={plan} length={length} at_s={at_s} />
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
