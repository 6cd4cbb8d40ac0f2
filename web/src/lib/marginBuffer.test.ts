import { describe, expect, it } from "vitest";

import {
  axisOf,
  BUCKET_MS,
  isJump,
  type MarginBuffer,
  type MarginSample,
  NO_MARGINS,
  runsOf,
  sampleAt,
  SPAN_MS,
  spanOf,
  withEarlier,
  withSample,
} from "./marginBuffer";

const sample = (at_ms: number, regular = 1, friction = regular): MarginSample => ({
  at_ms,
  regular,
  conservative: regular,
  friction,
});

const times = ({ samples, open }: MarginBuffer) =>
  [...samples, ...(open ? [open] : [])].map((s) => s.at_ms);

const fill = (...samples: MarginSample[]): MarginBuffer => samples.reduce(withSample, NO_MARGINS);

describe("the buffer of margins", () => {
  it("keeps the least of each span", () => {
    const { samples } = fill(
      sample(0, 1),
      sample(100, 0.2),
      sample(200, 0.9),
      sample(BUCKET_MS, 1),
      sample(2 * BUCKET_MS, 1),
    );
    expect(samples.map((s) => s.regular)).toEqual([0.2, 1]);
  });

  it("is replaced only when a span is full, so that nothing is drawn for every message", () => {
    const a = fill(sample(0), sample(BUCKET_MS));
    expect(withSample(a, sample(BUCKET_MS + 100)).samples).toBe(a.samples);
    expect(withSample(a, sample(2 * BUCKET_MS)).samples).not.toBe(a.samples);
  });

  it("a moment without a region is not lost", () => {
    const { samples } = fill(sample(0, NaN), sample(100, 1), sample(BUCKET_MS, 1));
    expect(samples[0]!.regular).toBeNaN();
  });

  it("is bounded in time and number", () => {
    let buffer = NO_MARGINS;
    for (let at = 0; at < 2 * SPAN_MS; at += 100) buffer = withSample(buffer, sample(at));
    expect(buffer.samples.length).toBeLessThanOrEqual(SPAN_MS / BUCKET_MS + 1);
    expect(buffer.samples[0]!.at_ms).toBeGreaterThanOrEqual(SPAN_MS - BUCKET_MS);
  });

  it("forgets what was later when time goes back", () => {
    const buffer = fill(...[0, 1000, 2000, 3000, 4000].map((t) => sample(t)), sample(1500));
    expect(buffer.samples.map((s) => s.at_ms)).toEqual([0, 1000]);
    expect(buffer.open?.at_ms).toBe(1500);
  });
});

describe("the lines", () => {
  it("break where there was no telemetry and where there was no region", () => {
    const samples = [sample(0), sample(500), sample(9000), sample(9500, 1, NaN), sample(10_000)];
    expect(runsOf(samples, "regular").map((r) => r.length)).toEqual([2, 3]);
    expect(runsOf(samples, "friction").map((r) => r.length)).toEqual([2, 1, 1]);
  });

  it("are read at the nearest sample, and nowhere in a gap", () => {
    const samples = [sample(0, 1), sample(500, 2), sample(20_000, 3)];
    expect(sampleAt(samples, 300)?.regular).toBe(2);
    expect(sampleAt(samples, 10_000)).toBeNull();
    expect(sampleAt([], 0)).toBeNull();
  });

  it("stand on a round axis with zero on it", () => {
    expect(axisOf([sample(0, 1.86)], 0.15)).toEqual([0, 2]);
    const [low, high] = axisOf([sample(0, -0.3), sample(1, 0.4)], 0.15);
    expect(low).toBeLessThanOrEqual(-0.3);
    expect(high).toBeGreaterThanOrEqual(0.4);
    expect(axisOf([sample(0, NaN)], 0.15)[0]).toBe(0);
  });

  it("fill the shortest span that shows them all", () => {
    expect(spanOf([sample(0), sample(30_000)])).toBe(1);
    expect(spanOf([sample(0), sample(100_000)])).toBe(2);
    expect(spanOf([sample(0), sample(SPAN_MS)])).toBe(5);
  });
});

describe("what came before a jump", () => {
  const range = (from: number, to: number, step = 1000) =>
    Array.from({ length: (to - from) / step + 1 }, (_, i) => sample(from + i * step));

  it("takes the place of what was gathered up to there", () => {
    const after = fill(...range(0, 3000), ...range(60_000, 62_000));
    const filled = withEarlier(after, range(20_000, 60_000));
    expect(times(filled)).toEqual(range(20_000, 62_000).map((s) => s.at_ms));
    expect(runsOf(filled.samples, "regular")).toHaveLength(1);
  });

  it("goes no farther back than the strip", () => {
    const filled = withEarlier(fill(sample(2 * SPAN_MS)), range(0, 2 * SPAN_MS));
    expect(filled.samples[0]!.at_ms).toBeGreaterThanOrEqual(SPAN_MS - BUCKET_MS);
    expect(withEarlier(fill(sample(5)), [])).toEqual(fill(sample(5)));
  });

  it("is a jump where time goes back, or on by more than a gap", () => {
    const jumps = [isJump(null, 5), isJump(10_000, 9_999), isJump(0, 3001)];
    expect(jumps).toEqual([true, true, true]);
    expect([isJump(0, 3000), isJump(10_000, 10_000)]).toEqual([false, false]);
  });
});
