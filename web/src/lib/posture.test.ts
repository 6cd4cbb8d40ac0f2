import { describe, expect, it } from "vitest";

import type {
  PostureAccidents,
  PostureAdvice,
  PostureAftermath,
  PostureMargins,
  PostureProposal,
} from "../api/types";
import {
  aftermathCell,
  barrierWords,
  changeName,
  costWords,
  marginPairs,
  offeredBy,
  postureRequest,
  USUAL_WISH,
  withoutLeg,
  waysBack,
} from "./posture";

const margins = (regular_m: number | null, torque_ratio = 0.4): PostureMargins => ({
  standing: ["leg1", "leg3", "leg4", "leg5", "leg6"],
  regular_m,
  regular_most_m: 1,
  settlement_m: null,
  conservative_region: "area",
  conservative_m: -0.1,
  conservative_most_m: 0.3,
  torque_ratio,
  torque_joint: "leg1_knee_pitch",
});

const proposal = (commands: number): PostureProposal =>
  ({ change: "chassis", commands: Array.from({ length: commands }) }) as PostureProposal;

describe("what is asked of the adviser", () => {
  it("leaves what is as usual to the server", () => {
    const usual = { stability: "regular", drive_hold: false, seed: 1 } as const;
    expect(postureRequest("leg2", USUAL_WISH, usual)).toEqual({ advice: { leg: "leg2" } });
    const wish = {
      regular_m: 0.3,
      conservative_m: 0,
      chassis: "level" as const,
      fold: false,
      replace: false,
    };
    expect(postureRequest("leg2", wish, usual)).toEqual({
      advice: {
        leg: "leg2",
        regular_m: 0.3,
        conservative_m: 0,
        chassis: "level",
        fold: false,
        replace: false,
      },
    });
  });
});

describe("what it is asked for with the options of plans", () => {
  const options = { stability: "conservative", drive_hold: true, seed: 7 } as const;

  it("goes by the preference where the wish says nothing else", () => {
    const advice = { leg: "leg2", conservative_m: 0, drive_hold: true };
    expect(postureRequest("leg2", USUAL_WISH, options)).toEqual({ advice, seed: 7 });
    const wish = { ...USUAL_WISH, conservative_m: 0.2 };
    expect(postureRequest("leg2", wish, options).advice?.conservative_m).toBe(0.2);
  });
});

describe("what it is asked for where plans go by friction", () => {
  const options = { stability: "friction", drive_hold: false, seed: 1 } as const;

  it("wishes for the rule's margin within what friction holds", () => {
    const advice = { leg: "leg2", friction_m: 0 };
    expect(postureRequest("leg2", USUAL_WISH, options)).toEqual({ advice });
  });

  it("shows the friction margin where it is told", () => {
    const keys = (before: PostureMargins, after: PostureMargins) =>
      marginPairs(before, after).map((pair) => pair.key);
    expect(keys(margins(0.1), margins(0.2))).not.toContain("friction");
    const pairs = marginPairs(margins(0.1), { ...margins(0.2), friction_m: 0.18 });
    expect(pairs.find((pair) => pair.key === "friction")).toEqual({
      key: "friction",
      name: "Friction",
      before: "none",
      after: "0.18 m",
      more: null,
    });
    const less = marginPairs(
      { ...margins(0.1), friction_m: 0.2 },
      { ...margins(0.2), friction_m: 0.1 },
    );
    expect(less.find((pair) => pair.key === "friction")?.more).toBe(false);
  });

  it("says what friction lacks", () => {
    const rule = { needed_m: 0.15, conservative: false, friction: true };
    const told = (friction_m: number | null) =>
      withoutLeg({ outcome: "best", before: { ...margins(0.3), friction_m } }, rule).says;
    expect(told(null)).toBe("friction does not hold without it");
    expect(told(0.05)).toBe("0.10 m of friction margin short without it");
    expect(told(0.2)).toBe("rule not met without it");
  });
});

describe("what it answers", () => {
  it("offers the proposals, else the best posture where it moves at all", () => {
    const advice = (proposals: PostureProposal[], best: PostureProposal | null) =>
      ({ proposals, best: best && { posture: best } }) as unknown as PostureAdvice;
    expect(offeredBy(advice([proposal(1), proposal(3)], null))).toHaveLength(2);
    expect(offeredBy(advice([], proposal(1)))).toHaveLength(1);
    expect(offeredBy(advice([], proposal(0)))).toEqual([]);
    expect(offeredBy(advice([], null))).toEqual([]);
  });

  it("names what moves and what it costs", () => {
    expect(changeName({ change: "chassis", replaced_leg: null }, "leg2")).toBe("Move the chassis");
    expect(changeName({ change: "fold", replaced_leg: null }, "leg2")).toBe("Lift and fold leg 2");
    expect(changeName({ change: "replace", replaced_leg: "leg5" }, "leg2")).toBe(
      "Put leg 5 elsewhere",
    );
    const cost = { chassis_m: 0.124, turn_rad: Math.PI / 90, legs_rad: 0, duration_s: 40 };
    expect(costWords({ cost })).toBe("body 12 cm · 2.0°");
    expect(costWords({ cost: { ...cost, chassis_m: 0, turn_rad: 0, legs_rad: Math.PI } })).toBe(
      "leg 180°",
    );
  });

  it("sets margins before and after beside each other", () => {
    const pairs = marginPairs(margins(0.1, 0.5), margins(0.25, 0.6));
    expect(pairs.map((p) => [p.key, p.before, p.after, p.more])).toEqual([
      ["regular", "0.10 m", "0.25 m", true],
      ["settlement", "none", "none", null],
      ["conservative", "−0.10 m", "−0.10 m", null],
      ["torque", "50 %", "60 %", false],
    ]);
  });

  it("says what stands in the way", () => {
    const barrier = { name: "region", missing: 0.12, unit: "m", detail: "leg2_knee is in the way" };
    expect(barrierWords(barrier)).toEqual({
      short: "These feet allow no more",
      missing: "0.12 m",
      detail: "Leg 2 knee is in the way",
    });
    expect(barrierWords({ name: "new_thing", missing: null, unit: "1", detail: "" })).toEqual({
      short: "New thing",
      missing: null,
      detail: null,
    });
  });

  it("says whether the rule holds without the leg", () => {
    let rule = { needed_m: 0.15, conservative: false, friction: false };
    const told = (before: Partial<PostureMargins>, outcome: PostureAdvice["outcome"] = "best") =>
      withoutLeg({ outcome, before: { ...margins(0.3), ...before } }, rule);
    expect(told({}, "already_met")).toEqual({ status: "normal", says: "0.30 m margin without it" });
    expect(told({ regular_m: -0.05 })).toEqual({
      status: "caution",
      says: "0.20 m short without it",
    });
    expect(told({ regular_m: null }).says).toBe("no margin without it");
    expect(told({ settlement_m: -0.1 }).says).toBe("tips on settling without it");
    expect(told({ torque_ratio: 1.2 }).says).toBe("a joint overloaded without it");
    expect(told({}).says).toBe("rule not met without it");
    rule = { ...rule, conservative: true };
    expect(told({}).says).toBe("a loss tips it without it");
  });
});

describe("the rehearsal", () => {
  const after = (more: Partial<PostureAftermath>, outcome = "not_needed"): PostureAftermath =>
    ({
      margin_m: 0.2,
      tips_over: false,
      rocks: false,
      way_back: { outcome },
      ...more,
    }) as PostureAftermath;

  it.each([
    [after({}), "0.20 m", "normal", "safe as it stands"],
    [after({}, "found"), "0.20 m", "caution", "a body shift leads back"],
    [after({}, "none"), "0.20 m", "serious", "no way back found"],
    [
      after({ rocks: true }, "found"),
      "0.20 m",
      "caution",
      "rocks onto it; a body shift leads back",
    ],
    [after({ margin_m: -0.1, tips_over: true }, "none"), "−0.10 m", "critical", "tips over"],
    [after({ margin_m: null, tips_over: true }, "none"), "none", "critical", "tips over"],
  ])("case %#", (accident, margin, status, says) => {
    expect(aftermathCell(accident)).toEqual({ margin, status, says });
  });
});

describe("ways back", () => {
  const after = (outcome: string, regular_m: number | null) => ({
    margin_m: 0.03,
    tips_over: false,
    rocks: false,
    way_back: {
      outcome,
      end: outcome === "found" ? {} : null,
      margins: regular_m === null ? null : { regular_m },
    },
  });
  it("are those that were found, leg by leg, with what they give", () => {
    const legs = [
      { leg: "leg1", lost: after("found", 0.1), settled: after("not_needed", null) },
      { leg: "leg2", lost: after("none", null), settled: after("found", 0.25) },
    ] as unknown as PostureAccidents[];
    const ways = waysBack(legs);
    expect(ways.map((way) => way.accident)).toEqual([
      { leg: "leg1", kind: "lost" },
      { leg: "leg2", kind: "settled" },
    ]);
    expect(ways.map((way) => way.says)).toEqual([
      "Leg 1 lost: 0.03 → 0.10 m",
      "Leg 2 settles: 0.03 → 0.25 m",
    ]);
    expect(waysBack([])).toEqual([]);
  });
});
