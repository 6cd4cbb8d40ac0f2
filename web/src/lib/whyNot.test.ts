import { describe, expect, it } from "vitest";

import { canStand, whatHelps, whyNot } from "./whyNot";

const NOT = { reason: 0, missing: NaN, margin_m: NaN };

describe("why not here", () => {
  it("tells the margin of a reachable cell", () => {
    expect(whyNot({ ...NOT, class: 4, margin_m: 0.42 })).toEqual({
      verdict: "reachable",
      reason: null,
      missing: null,
      margin: "0.42 m",
    });
  });

  it("tells class, reason and what is missing in the reason's unit", () => {
    expect(whyNot({ class: 1, reason: 2, missing: Math.PI / 18, margin_m: NaN })).toEqual({
      verdict: "unreachable",
      reason: "a joint beyond its limit",
      missing: "10.0°",
      margin: null,
    });
    expect(whyNot({ ...NOT, class: 2, reason: 4, missing: 0.07, margin_m: 0.08 })).toMatchObject({
      verdict: "unstable",
      missing: "0.07 m",
      margin: "0.08 m",
    });
    expect(whyNot({ ...NOT, class: 2, reason: 10, missing: 0.2 }).missing).toBe("20 %");
  });

  it("knows ground that is unsafe for a wheel, with or without a figure", () => {
    const unsafe = whyNot({ ...NOT, class: 1, reason: 13, missing: 0.12 });
    expect(unsafe.reason).toBe("ground unsafe for a wheel");
    expect(unsafe.missing).toBe("0.12 of goodness");
    expect(whyNot({ ...NOT, class: 1, reason: 13 }).missing).toBeNull();
  });

  it("does not hide a reason that this console has no words for", () => {
    expect(whyNot({ ...NOT, class: 1, reason: 99 }).reason).toBe("reason 99");
    expect(whyNot({ ...NOT, class: 0 })).toMatchObject({ verdict: "unknown", reason: null });
  });

  it("knows cells that were planned to, and those that no step was found to", () => {
    expect(whyNot({ ...NOT, class: 6, margin_m: 0.3 })).toEqual({
      verdict: "plannable",
      reason: null,
      missing: null,
      margin: "0.30 m",
    });
    expect(whyNot({ ...NOT, class: 7, reason: 14 })).toMatchObject({
      verdict: "no plan",
      reason: "the leg can stand here, but no step to it was found",
      missing: null,
    });
    expect([4, 6].every(canStand)).toBe(true);
    expect([0, 1, 2, 3, 5, 7].some(canStand)).toBe(false);
  });
});

describe("what would help", () => {
  it("names what is in the way once, and what was tried", () => {
    const told = {
      obstruction: "leg2_knee_pitch would be 0.20 rad beyond its limit",
      mends: [{ shift_m: [0, 0, 0.08] }, { place_m: [1.5, 2] as [number, number] }],
    };
    expect(whatHelps(told, [1.2, 2.4, 0])).toEqual({
      what: "Leg 2 knee pitch would be 0.20 rad beyond its limit.",
      mends: "Stand 0.08 m taller, or take the place 0.50 m beside, at 1.50, 2.00.",
    });
    expect(whatHelps({ obstruction: null, mends: [{ shift_m: [0.1, -0.05, 0] }] }, [0, 0])).toEqual(
      {
        what: null,
        mends: "Shift the body by 0.10, −0.05 m.",
      },
    );
    expect(whatHelps({ obstruction: null, mends: [] }, [0, 0]).mends).toMatch(/^Nothing/);
  });
});
