import { describe, expect, it } from "vitest";

import { chosenOptions, DEFAULT_OPTIONS, planRequest } from "./planOptions";

const target = { position_m: [1, 2, 0] };

describe("a request for a plan", () => {
  it("leaves to the server what was not chosen", () => {
    expect(planRequest("leg1", [1, 2, 0], DEFAULT_OPTIONS)).toEqual({ leg: "leg1", target });
    expect(chosenOptions(DEFAULT_OPTIONS)).toEqual([]);
  });

  it("carries what was chosen, buffers together", () => {
    const options = {
      ...DEFAULT_OPTIONS,
      planner: "sbl" as const,
      terrain_lift_m: 0.15,
      preload: false,
      seed: 7,
    };
    expect(planRequest("leg1", [1, 2, 0], options)).toEqual({
      leg: "leg1",
      target,
      planner: "sbl",
      buffers: { terrain_lift_m: 0.15 },
      preload: false,
      seed: 7,
    });
    expect(chosenOptions(options)).toEqual(["planner", "terrain_lift_m", "preload", "seed"]);
  });
});
