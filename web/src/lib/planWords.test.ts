import { describe, expect, it } from "vitest";

import type { PlanAnswer } from "../api/types";
import {
  inTheWay,
  inTheWayOf,
  milliseconds,
  missingFigure,
  phaseSpans,
  wayBack,
  whySentence,
} from "./planWords";

type Missing = [name: string, missing: number | null, unit: string];

function plan(of: Missing | null, outcome = "unreachable") {
  const constraint = of && { name: of[0], missing: of[1], unit: of[2], detail: "" };
  return { leg: "leg2", outcome, reason: null, constraint } as PlanAnswer;
}

describe("what is in the way of a plan", () => {
  it.each<[Missing, string]>([
    [["reach", 0.12, "m"], "0.12 m out of reach"],
    [["reach", null, "m"], "out of reach"],
    [["joint_limits", Math.PI / 36, "rad"], "a joint 5.0° beyond its limit"],
    [["clearance", 0.019, "m"], "1.9 cm too little clearance"],
    [["clearance", 0.0999, "m"], "0.10 m too little clearance"],
    [["stability", 0.3, "m"], "0.30 m too little margin"],
    [["torque", 0.08, "share"], "a joint 8 % over its torque"],
    [["unknown_ground", null, "m"], "ground not seen"],
    [["search", NaN, "share"], "no way found within the budget"],
    [["sun_angle", 1, "rad"], "sun angle"],
  ])("%j", (missing, expected) => expect(inTheWay(plan(missing))).toBe(expected));

  it("is told by the outcome where no constraint is named", () => {
    expect(inTheWayOf(plan(null))).toBe("Leg 2: out of reach");
    expect(inTheWay(plan(null, "no_path"))).toBe("no way found");
    expect(inTheWay(plan(null, "of_a_later_version"))).toBe("of a later version");
  });

  it("has a figure only where something is missing", () => {
    expect(missingFigure(plan(["reach", 0.5, "m"]))).toBe("0.50 m");
    expect(missingFigure(plan(["reach", 0, "m"]))).toBeNull();
    expect(missingFigure(plan(null))).toBeNull();
  });

  it("comes with the server's sentence, as words", () => {
    const said = { constraint: null, reason: "leg1_wheel_link and leg2_ankle_roll_link touch" };
    expect(whySentence(said)).toBe("Leg 1 wheel and leg 2 ankle roll touch");
    expect(whySentence({ constraint: null, reason: null })).toBeNull();
  });
});

it("times have a decimal while they are short", () => {
  expect([3.44, 9.97, 72.8].map(milliseconds)).toEqual(["3.4 ms", "10 ms", "73 ms"]);
});

describe("the parts of a plan", () => {
  const at = (phase: string, time_s: number) =>
    ({ phase, time_s }) as Parameters<typeof phaseSpans>[0][number];

  it("run from where the part before them ends", () => {
    const waypoints = [at("shift", 0), at("shift", 4), at("shift", 8), at("lift", 10)];
    expect(phaseSpans([...waypoints, at("transit", 15)])).toEqual([
      { phase: "shift", from_s: 0, to_s: 8 },
      { phase: "lift", from_s: 8, to_s: 10 },
      { phase: "transit", from_s: 10, to_s: 15 },
    ]);
    expect(phaseSpans([])).toEqual([]);
  });

  it("are undone from the last that was executed", () => {
    const [lift, move, drop] = ["lift", "move", "drop"].map(
      (title) => ({ title }) as Parameters<typeof wayBack>[0]["commands"][number],
    );
    const plan = { commands: [lift!, move!, drop!], retreat: [drop!, move!, lift!] };
    const titles = (done: number) => wayBack(plan, done).map((c) => c.title);
    expect([0, 1, 2].map(titles)).toEqual([[], ["lift"], ["move", "lift"]]);
  });
});
