// The margins of the last minutes over the time on board, with what the rule asks for as a line.

import { memo, useRef, useState } from "react";

import { metres, signless } from "../../lib/format";
import {
  axisOf,
  type MarginSample,
  runsOf,
  sampleAt,
  type Series,
  SERIES,
  spanOf,
} from "../../lib/marginBuffer";
import { formatClock } from "../../lib/time";
import { REGIONS } from "../../scene/palette";
import { useMarginHistory } from "../../store/marginHistory";

const NAMES: Record<Series, string> = {
  regular: "regular",
  conservative: "conservative",
  friction: "friction",
};

const [W, H] = [280, 96];
const LEFT = 26;
const BOTTOM = 14;
const TOP = 5;

const dashOf = (series: Series) => REGIONS.find((r) => r.key === series)?.stroke ?? "";

interface Frame {
  x: (at_ms: number) => number;
  y: (margin_m: number) => number;
  time: (x: number) => number;
}

function frameOf(end_ms: number, minutes: number, [low, high]: [number, number]): Frame {
  const span_ms = minutes * 60_000;
  const start = end_ms - span_ms;
  return {
    x: (at_ms) => LEFT + ((at_ms - start) / span_ms) * (W - LEFT - 2),
    y: (m) => TOP + ((high - m) / (high - low)) * (H - TOP - BOTTOM),
    time: (x) => start + ((x - LEFT) / (W - LEFT - 2)) * span_ms,
  };
}

/** Drawn again when a span of the history is full, not with every message. */
export const MarginStrip = memo(function MarginStrip({ needed_m }: { needed_m: number }) {
  const samples = useMarginHistory((s) => s.samples);
  const [hovered_ms, setHovered] = useState<number | null>(null);
  const svg = useRef<SVGSVGElement>(null);
  const last = samples.at(-1);
  if (!last) {
    return (
      <section className="section quiet small" aria-label="Margins over time">
        Margins over time appear as telemetry comes.
      </section>
    );
  }
  const minutes = spanOf(samples);
  const axis = axisOf(samples, needed_m);
  const frame = frameOf(last.at_ms, minutes, axis);
  const hovered = hovered_ms === null ? null : sampleAt(samples, hovered_ms);
  const onMove = (event: React.PointerEvent) => {
    const box = svg.current?.getBoundingClientRect();
    if (box) setHovered(frame.time(((event.clientX - box.left) / box.width) * W));
  };
  return (
    <section className="section margin-history of-rover" aria-label="Margins over time">
      <div className="row between">
        <h2>{minutes === 1 ? "Last minute" : `Last ${minutes} minutes`}</h2>
        <span className="num quiet small" data-testid="strip-at" title="Time on board">
          {hovered ? formatClock(hovered.at_ms, true) : "on-board time"}
        </span>
      </div>
      <svg
        ref={svg}
        viewBox={`0 0 ${W} ${H}`}
        role="img"
        aria-label={`Margins over time, regular ${metres(last.regular)} at the end`}
        data-testid="margin-history"
        data-samples={samples.length}
        onPointerMove={onMove}
        onPointerLeave={() => setHovered(null)}
      >
        <Axes axis={axis} frame={frame} needed_m={needed_m} minutes={minutes} />
        {SERIES.map((series) => (
          <Line key={series} series={series} samples={samples} frame={frame} />
        ))}
        {hovered && <Cursor sample={hovered} frame={frame} />}
      </svg>
      <StripLegend sample={hovered ?? last} needed_m={needed_m} />
    </section>
  );
});

interface AxesProps {
  axis: [number, number];
  frame: Frame;
  needed_m: number;
  minutes: number;
}

/** Seconds before the last sample that are marked. */
const ticksOf = (minutes: number): number[] =>
  minutes === 1 ? [0, 20, 40, 60] : minutes === 2 ? [0, 30, 60, 120] : [0, 60, 180, 300];

function Axes({ axis: [low, high], frame, needed_m, minutes }: AxesProps) {
  const decimals = high - low < 5 ? 1 : 0;
  const marks = [...new Set([low, 0, high])];
  return (
    <>
      {marks.map((m) => (
        <g key={m}>
          <path d={`M${LEFT} ${frame.y(m)}H${W}`} stroke="var(--line)" />
          <text className="strip-text" x={LEFT - 4} y={frame.y(m) + 3} textAnchor="end">
            {signless(m, decimals)}
          </text>
        </g>
      ))}
      <path
        d={`M${LEFT} ${frame.y(needed_m)}H${W}`}
        stroke="var(--serious)"
        strokeDasharray="1 3"
        strokeLinecap="round"
      />
      {ticksOf(minutes).map((back_s, i) => {
        const x = frame.x(frame.time(W - 2) - back_s * 1000);
        const anchor = back_s === 0 ? "end" : back_s === minutes * 60 ? "start" : "middle";
        return (
          <g key={back_s}>
            <path d={`M${x} ${H - BOTTOM}v3`} stroke="var(--line-strong)" />
            <text className="strip-text" x={x} y={H - 2} textAnchor={anchor}>
              {i === 0 ? "0" : `−${back_s < 60 ? `${back_s} s` : `${back_s / 60} min`}`}
            </text>
          </g>
        );
      })}
    </>
  );
}

function Line(props: { series: Series; samples: MarginSample[]; frame: Frame }) {
  const { series, samples, frame } = props;
  const path = runsOf(samples, series)
    .map((run) => {
      const points = run.map(
        (p) => `${frame.x(p.at_ms).toFixed(1)} ${frame.y(p.margin_m).toFixed(1)}`,
      );
      // A lone sample is a dot.
      return `M${points.join("L")}${points.length === 1 ? "h0.01" : ""}`;
    })
    .join("");
  return (
    <path
      d={path}
      fill="none"
      stroke={`var(--series-${series})`}
      strokeWidth={series === "friction" ? 2 : 1.4}
      strokeDasharray={dashOf(series)}
      strokeLinejoin="round"
    />
  );
}

function Cursor({ sample, frame }: { sample: MarginSample; frame: Frame }) {
  const x = frame.x(sample.at_ms);
  return (
    <g pointerEvents="none">
      <path d={`M${x} ${TOP}V${H - BOTTOM}`} stroke="var(--accent)" />
      {SERIES.filter((series) => !Number.isNaN(sample[series])).map((series) => (
        <circle
          key={series}
          cx={x}
          cy={frame.y(sample[series])}
          r="2.5"
          fill={`var(--series-${series})`}
        />
      ))}
    </g>
  );
}

/** Which line is which, with the values under the pointer, else the last ones. */
function StripLegend({ sample, needed_m }: { sample: MarginSample; needed_m: number }) {
  return (
    <ul className="strip-legend small">
      {SERIES.map((series) => (
        <li key={series} className="row">
          <LineKey color={`var(--series-${series})`} dash={dashOf(series)} />
          <span className="quiet">{NAMES[series]}</span>
          <span className="num" data-testid={`strip-${series}`}>
            {Number.isNaN(sample[series]) ? "none" : metres(sample[series])}
          </span>
        </li>
      ))}
      <li className="row">
        <LineKey color="var(--serious)" dash="1 3" />
        <span className="quiet">needed</span>
        <span className="num">{metres(needed_m)}</span>
      </li>
    </ul>
  );
}

function LineKey({ color, dash }: { color: string; dash: string }) {
  return (
    <svg width="22" height="8" viewBox="0 0 22 8" aria-hidden>
      <path d="M1 4h20" stroke={color} strokeWidth="2" strokeDasharray={dash} />
    </svg>
  );
}
