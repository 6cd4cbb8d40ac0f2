import { describe, expect, it } from "vitest";

import type { PlanAnalysis } from "../api/types";
import { leastOf, marginsAt, planMargins, runsOf } from "./planMargins";

type Told = Pick<PlanAnalysis, "margins">;
const of = (margins: unknown) => planMargins({ margins } as unknown as Told);

const columns = {
  time_s: [0, 2, 4, 6],
  regular_m: [0.4, 0.2, 0.3, 0.3],
  conservative_m: [0.1, null, -0.1, 0.1],
  friction_m: [0.3, 0.2, 0.2, null],
  energy_j: [100, 60, 80, 80],
  energy_m: [0.1, 0.06, 0.08, 0.08],
  critical: ["leg1-leg3", "leg1-leg3", "leg4-leg5", null],
};

describe("margins along a plan", () => {
  it("are read at any time, with gaps where a kind is not told", () => {
    const margins = of(columns)!;
    expect(marginsAt(margins, 1)).toMatchObject({ conservative: null, critical: "leg1-leg3" });
    expect(marginsAt(margins, 1).regular).toBeCloseTo(0.3, 12);
    expect(marginsAt(margins, 3).energy_j).toBeCloseTo(70, 12);
    expect(marginsAt(margins, 4)).toMatchObject({ conservative: -0.1, friction: 0.2 });
    expect(marginsAt(margins, 5).friction).toBeNull();
    expect(marginsAt(margins, -1).regular).toBe(0.4);
    expect(marginsAt(margins, 99)).toMatchObject({ regular: 0.3, friction: null, critical: null });
    expect(leastOf(margins)).toEqual({ time_s: 2, margin_m: 0.2 });
    expect(runsOf(margins, "conservative")).toEqual([
      [[0, 0.1]],
      [
        [4, -0.1],
        [6, 0.1],
      ],
    ]);
  });

  it("are understood where the regular one alone is told, or a kind is absent", () => {
    const margins = of([
      { time_s: 0, margin_m: 0.5 },
      { time_s: 1, margin_m: 0.1 },
    ])!;
    expect(leastOf(margins)).toEqual({ time_s: 1, margin_m: 0.1 });
    expect(marginsAt(margins, 0.5)).toMatchObject({ friction: null, energy_m: null });
    expect(runsOf(margins, "friction")).toEqual([]);
    const { friction_m, critical, ...fewer } = columns;
    expect([friction_m, critical]).toBeDefined();
    expect(marginsAt(of(fewer)!, 2)).toMatchObject({
      regular: 0.2,
      friction: null,
      critical: null,
    });
  });

  it("are nothing to draw where there are too few", () => {
    expect(of([])).toBeNull();
    expect(of(undefined)).toBeNull();
    expect(of({})).toBeNull();
    expect(of({ ...columns, time_s: [0] })).toBeNull();
    expect(of({ ...columns, time_s: [0, null] })).toBeNull();
    const none = of({ time_s: [0, 1] })!;
    expect(leastOf(none)).toBeNull();
  });
});
