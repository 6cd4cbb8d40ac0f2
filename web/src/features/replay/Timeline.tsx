// The time line of a replay; it takes the place of the step strip, since nothing can be sent.

import { Pause, Play, SkipBack } from "lucide-react";
import { useRef, useState } from "react";

import type { ReplayState } from "../../api/types";
import { formatClock, formatDay, formatSpan, parseTime, toRfc3339 } from "../../lib/time";
import { useShownNow } from "../../store/now";
import { backToLive, changeReplay, useLogs } from "../../store/replay";
import "./replay.css";

const RATES = [0.1, 0.5, 1, 2, 5, 10, 50, 200, 1000];

export function Timeline({ replay }: { replay: ReplayState }) {
  const failure = useLogs((s) => s.failure);
  return (
    <section className="timeline" aria-label="Replay">
      <button
        type="button"
        className="button icon"
        aria-label="To the beginning"
        title="To the beginning"
        onClick={() => void changeReplay({ at: replay.start })}
      >
        <SkipBack size={16} />
      </button>
      <button
        type="button"
        className="button icon"
        data-testid="replay-toggle"
        aria-label={replay.paused ? "Go on" : "Hold"}
        title={`${replay.paused ? "Go on" : "Hold"} (space)`}
        onClick={() => void changeReplay({ paused: !replay.paused })}
      >
        {replay.paused ? <Play size={16} /> : <Pause size={16} />}
      </button>
      <Scrubber replay={replay} />
      <label className="row quiet">
        speed
        <select
          className="rate num"
          data-testid="replay-rate"
          value={RATES.includes(replay.rate) ? replay.rate : ""}
          onChange={(event) => void changeReplay({ rate: Number(event.target.value) })}
        >
          {!RATES.includes(replay.rate) && <option value="">{replay.rate} ×</option>}
          {RATES.map((rate) => (
            <option key={rate} value={rate}>
              {rate} ×
            </option>
          ))}
        </select>
      </label>
      {failure && (
        <span className="trouble small" role="alert">
          {failure}
        </span>
      )}
      <button
        type="button"
        className="button primary"
        data-testid="back-to-live"
        onClick={() => void backToLive()}
      >
        Back to live
      </button>
    </section>
  );
}

function Scrubber({ replay }: { replay: ReplayState }) {
  const now = useShownNow();
  const [start, end] = [parseTime(replay.start), parseTime(replay.end)];
  // While the handle is held the replay's own progress must not pull it away.
  const [held, setHeld] = useState<number | null>(null);
  const pending = useRef(0);
  const at = held ?? now;
  const seek = (to: number) => {
    clearTimeout(pending.current);
    pending.current = window.setTimeout(() => {
      void changeReplay({ at: toRfc3339(Math.min(Math.max(to, start), end)) }).then(() =>
        setHeld(null),
      );
    }, 120);
  };
  return (
    <div className="timeline-scrub">
      <span className="num" data-testid="replay-at">
        {formatDay(at)} {formatClock(at, true)}
      </span>
      <input
        type="range"
        data-testid="replay-scrub"
        aria-label="Place in the log"
        aria-valuetext={`${formatSpan((at - start) / 1000)} of ${formatSpan((end - start) / 1000)}`}
        min={start}
        max={end}
        step={100}
        value={at}
        onChange={(event) => {
          const to = Number(event.target.value);
          setHeld(to);
          seek(to);
        }}
      />
      <span className="num quiet">
        {formatSpan((at - start) / 1000)} / {formatSpan((end - start) / 1000)}
      </span>
    </div>
  );
}
