// The time line of a replay; it takes the place of the step strip, since nothing can be sent.

import { Pause, Play, SkipBack } from "lucide-react";
import { useRef, useState } from "react";

import type { ReplayState } from "../../api/types";
import { formatClock, formatDay, formatSpan, parseTime, toRfc3339 } from "../../lib/time";
import { useShownNow } from "../../store/now";
import { backToLive, changeReplay, useLogs } from "../../store/replay";
import "./replay.css";

/** A moving handle asks for its place when it rests this long (ms). */
const SETTLE_MS = 120;
const RATES = [0.1, 0.5, 1, 2, 5, 10, 50, 200, 1000];

export function Timeline({ replay }: { replay: ReplayState }) {
  const failure = useLogs((s) => s.failure);
  const [start, end] = [parseTime(replay.start), parseTime(replay.end)];
  // While the handle is held the replay's own progress must not pull it away.
  const [held, setHeld] = useState<number | null>(null);
  const pending = useRef(0);
  /** The last place asked for wins, however fast they follow each other. */
  const seek = (to: number, wait_ms: number) => {
    clearTimeout(pending.current);
    setHeld(to);
    const mine = window.setTimeout(() => {
      const at = toRfc3339(Math.min(Math.max(to, start), end));
      void changeReplay({ at }).then(() => pending.current === mine && setHeld(null));
    }, wait_ms);
    pending.current = mine;
  };
  return (
    <section className="timeline" aria-label="Replay">
      <button
        type="button"
        className="button icon"
        aria-label="To the beginning"
        title="To the beginning"
        onClick={() => seek(start, 0)}
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
      <Scrubber start={start} end={end} held={held} seek={(to) => seek(to, SETTLE_MS)} />
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

interface ScrubberProps {
  start: number;
  end: number;
  held: number | null;
  seek: (to: number) => void;
}

function Scrubber({ start, end, held, seek }: ScrubberProps) {
  const now = useShownNow();
  const at = held ?? now;
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
        onChange={(event) => seek(Number(event.target.value))}
      />
      <span className="num quiet">
        {formatSpan((at - start) / 1000)} / {formatSpan((end - start) / 1000)}
      </span>
    </div>
  );
}
