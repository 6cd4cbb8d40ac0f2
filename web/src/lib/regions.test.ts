import { describe, expect, it } from "vitest";

import type { StabilityDerived, Vec2 } from "../api/types";
import { beside, coincide, feetLabel, feetOf, regionOf } from "./regions";

const SQUARE: Vec2[] = [
  [-1, -1],
  [1, -1],
  [1, 1],
  [-1, 1],
];

const stability = {
  com_m: [0, 0, 1],
  conservative_kind: "empty",
  torque_joint: "",
  torque_ratio: 0,
  torque_ratios: {},
} as StabilityDerived;

describe("a region", () => {
  it("is unknown where the message does not tell, and empty with its reason where it does", () => {
    expect(regionOf(null, "regular").kind).toBe("unknown");
    expect(regionOf(stability, "friction").kind).toBe("unknown");
    expect(regionOf(stability, "regular")).toMatchObject({ kind: "empty", polygon: null });
    expect(regionOf(stability, "conservative").whyEmpty).toContain("Fewer than three feet");
    const forces = { friction: { kind: "empty", why_empty: "too steep" } };
    const told = { ...stability, forces } as unknown as StabilityDerived;
    expect(regionOf(told, "friction")).toMatchObject({ kind: "empty", whyEmpty: "Too steep" });
  });
});

describe("what decides", () => {
  it("reads both ways in which the server names feet", () => {
    expect(feetOf("leg2 and leg3")).toEqual(["leg2", "leg3"]);
    expect(feetOf("leg1, leg2, leg4")).toEqual(["leg1", "leg2", "leg4"]);
    expect(feetOf(null)).toEqual([]);
  });

  it("is named shortly, also for legs without numbers", () => {
    expect(feetLabel(["leg2", "leg3"])).toBe("legs 2–3");
    expect(feetLabel(["leg4"])).toBe("leg 4");
    expect(feetLabel(["leg1", "leg2", "leg4"])).toBe("legs 1, 2, 4");
    expect(feetLabel(["front_left", "rear_left"])).toBe("front_left–rear_left");
    expect(feetLabel(["leg1", "leg2", "leg3"], 3)).toBe("all feet");
    expect(feetLabel(["leg1", "leg2"], 2)).toBe("legs 1–2");
    expect(feetLabel([])).toBe("");
  });
});

describe("outlines that would hide each other", () => {
  it("run side by side where they are the same, and where they are elsewhere", () => {
    const [x, y] = beside([1, 1], SQUARE, [SQUARE]);
    expect(Math.hypot(1 - x, 1 - y)).toBeCloseTo(0.05, 9);
    expect(x).toBeLessThan(1);
    const [x2] = beside([1, 1], SQUARE, [SQUARE, SQUARE]);
    expect(x2).toBeLessThan(x);
    expect(beside([0.8, 0.8], SQUARE, [SQUARE])).toEqual([0.8, 0.8]);
  });

  it("coincide whatever the number of their corners", () => {
    const cornered: Vec2[] = [[0, -1], ...SQUARE.slice(1), SQUARE[0]!];
    expect(coincide(SQUARE, cornered)).toBe(true);
    expect(
      coincide(
        SQUARE,
        SQUARE.map(([x, y]) => [0.9 * x, y]),
      ),
    ).toBe(false);
  });
});
