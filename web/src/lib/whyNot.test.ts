import { describe, expect, it } from "vitest";

import { whyNot } from "./whyNot";

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
});
