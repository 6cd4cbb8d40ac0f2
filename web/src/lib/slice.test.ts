import { describe, expect, it } from "vitest";

import { headingWords, roundUp, slicePoints, yawOf } from "./slice";

describe("the energy slice", () => {
  it("has its values at even distances", () => {
    const points = slicePoints({ length_m: 1.2, height_m: [0.4, 0.3, 0.1, 0] });
    expect(points.map((p) => p.at_m)).toEqual([0, expect.closeTo(0.4), expect.closeTo(0.8), 1.2]);
    expect(points[2]!.rise_m).toBe(0.1);
    const past = slicePoints({ length_m: 1.2, height_m: [0.4, 0.1, -0.3, -0.9] });
    expect(past).toHaveLength(3);
    expect(past[2]).toEqual({ at_m: expect.closeTo(0.5, 12), rise_m: 0 });
    expect(slicePoints({ length_m: 1, height_m: [-0.1, -0.2] })).toEqual([]);
    expect(slicePoints({ length_m: 1, height_m: [0.4] })).toEqual([]);
    expect(slicePoints({ length_m: NaN, height_m: [0, 1] })).toEqual([]);
  });

  it("ends its axes at round figures", () => {
    expect([0, 0.04, 0.21, 1.6, 9, 14].map(roundUp)).toEqual([0.05, 0.05, 0.3, 2, 10, 20]);
  });

  it("names headings from the rover's own forward", () => {
    const words = [0, Math.PI / 6, -Math.PI / 2, Math.PI, -Math.PI].map(headingWords);
    expect(words).toEqual(["ahead", "30° to the left", "90° to the right", "back", "back"]);
  });

  it("reads the yaw of a rover that leans", () => {
    const half = Math.PI / 8;
    expect(yawOf([0, 0, Math.sin(half), Math.cos(half)])).toBeCloseTo(Math.PI / 4, 12);
    // Turned by 90° about z, then leaning by 20° about its own y.
    const [s, c, t, u] = [Math.SQRT1_2, Math.SQRT1_2, Math.sin(0.175), Math.cos(0.175)];
    expect(yawOf([-s * t, c * t, s * u, c * u])).toBeCloseTo(Math.PI / 2, 9);
  });
});
