// Margins over the last minutes, bounded: the least of each short span is kept, so that a dip is
// never lost to thinning, and a gap in the telemetry stays a gap.

export const SPAN_MS = 5 * 60_000;
export const BUCKET_MS = 500;
/** Without telemetry for this long the line breaks. */
export const GAP_MS = 3000;

export interface MarginSample {
  /** On board (ms). */
  at_ms: number;
  /** Meters; NaN where there is no such region. */
  regular: number;
  conservative: number;
  friction: number;
}

export type Series = "regular" | "conservative" | "friction";
export const SERIES: Series[] = ["regular", "conservative", "friction"];

/** Oldest first; `samples` is replaced, never changed, so that it can be compared. */
export interface MarginBuffer {
  samples: MarginSample[];
  /** The span that still gathers. */
  open: MarginSample | null;
}

export const NO_MARGINS: MarginBuffer = { samples: [], open: null };

const bucket = (at_ms: number) => Math.floor(at_ms / BUCKET_MS);

/** Where there was none for a moment, that moment is the least. */
const least = (a: number, b: number) => (Number.isNaN(a) || Number.isNaN(b) ? NaN : Math.min(a, b));

function worse(a: MarginSample, b: MarginSample): MarginSample {
  return {
    at_ms: b.at_ms,
    regular: least(a.regular, b.regular),
    conservative: least(a.conservative, b.conservative),
    friction: least(a.friction, b.friction),
  };
}

export function withSample(buffer: MarginBuffer, sample: MarginSample): MarginBuffer {
  const { open } = buffer;
  if (!open) return { ...buffer, open: sample };
  if (sample.at_ms < open.at_ms) return withSample(before(buffer, sample.at_ms), sample);
  if (bucket(sample.at_ms) === bucket(open.at_ms)) return { ...buffer, open: worse(open, sample) };
  const first = sample.at_ms - SPAN_MS;
  const from = [...buffer.samples, open].findIndex((s) => s.at_ms >= first);
  const samples = from < 0 ? [] : [...buffer.samples, open].slice(from);
  return { samples, open: sample };
}

/** A replay that went back un-happens what came later. */
function before({ samples }: MarginBuffer, at_ms: number): MarginBuffer {
  return { samples: samples.filter((s) => s.at_ms < at_ms), open: null };
}

/** Put before what was gathered since: what came earlier, oldest first, as the log has it. */
export function withEarlier(buffer: MarginBuffer, earlier: MarginSample[]): MarginBuffer {
  const until_ms = earlier.at(-1)?.at_ms;
  if (until_ms === undefined) return buffer;
  const own = buffer.open ? [...buffer.samples, buffer.open] : buffer.samples;
  const since = own.filter((s) => bucket(s.at_ms) > bucket(until_ms));
  return [...earlier, ...since].reduce(withSample, NO_MARGINS);
}

/** Did what is shown jump, so that there is more to know of what came before? */
export function isJump(last_ms: number | null, at_ms: number): boolean {
  return last_ms === null || at_ms < last_ms || at_ms - last_ms > GAP_MS;
}

export interface Point {
  at_ms: number;
  margin_m: number;
}

/** The unbroken runs of one series. */
export function runsOf(samples: MarginSample[], series: Series): Point[][] {
  const runs: Point[][] = [];
  let last: MarginSample | null = null;
  for (const sample of samples) {
    const margin_m = sample[series];
    const told = !Number.isNaN(margin_m);
    const goes_on =
      last !== null && sample.at_ms - last.at_ms <= GAP_MS && !Number.isNaN(last[series]);
    if (told && goes_on) runs.at(-1)!.push({ at_ms: sample.at_ms, margin_m });
    else if (told) runs.push([{ at_ms: sample.at_ms, margin_m }]);
    last = sample;
  }
  return runs;
}

/** The sample nearest to a time, if one is near enough to speak for it. */
export function sampleAt(samples: MarginSample[], at_ms: number): MarginSample | null {
  let best: MarginSample | null = null;
  for (const sample of samples) {
    if (best && Math.abs(sample.at_ms - at_ms) > Math.abs(best.at_ms - at_ms)) break;
    best = sample;
  }
  return best && Math.abs(best.at_ms - at_ms) <= GAP_MS ? best : null;
}

/** A calm axis: from zero or a whole step below the least, to a whole step above the most. */
export function axisOf(samples: MarginSample[], needed_m: number): [low: number, high: number] {
  const values = samples.flatMap((s) => SERIES.map((k) => s[k]).filter((v) => !Number.isNaN(v)));
  const most = Math.max(1.5 * needed_m, ...values);
  const least_m = Math.min(0, ...values);
  const step = [0.1, 0.2, 0.5, 1, 2, 5].find((s) => (most - least_m) / s <= 5) ?? 10;
  return [Math.floor(least_m / step) * step, Math.ceil(most / step + 1e-9) * step];
}

const SPANS_MIN = [1, 2, 5];

/** The shortest whole span (min) that shows all there is. */
export function spanOf(samples: MarginSample[]): number {
  const told_ms = (samples.at(-1)?.at_ms ?? 0) - (samples[0]?.at_ms ?? 0);
  return SPANS_MIN.find((minutes) => told_ms <= minutes * 60_000) ?? SPAN_MS / 60_000;
}
