import { describe, expect, it } from "vitest";

import type { RoverState } from "../api/types";
import { poseAt } from "./pose";

const HALF = Math.SQRT1_2;

function stance(x: number, hip: number, turned = false): RoverState {
  return {
    base: { position_m: [x, 0, 1], orientation_xyzw: turned ? [0, 0, HALF, HALF] : [0, 0, 0, 1] },
    joints_rad: { leg1: [hip], leg2: [2 * hip] },
  };
}

const reported = stance(0, 0);

describe("the pose along a plan", () => {
  const still = [
    { joints_rad: [0], time_s: 0 },
    { joints_rad: [1], time_s: 2 },
  ];
  const shifting = [
    { joints_rad: [0], time_s: 0 },
    { joints_rad: [0.5], time_s: 2, stance: stance(0.2, 0.5, true) },
    { joints_rad: [1.5], time_s: 4, stance: stance(0.2, 0.5, true) },
  ];

  it("is that of the leg alone while the body stands", () => {
    expect(poseAt("leg1", still, 1, reported)).toEqual({
      leg: "leg1",
      joints_rad: [0.5],
      stance: null,
    });
    expect(poseAt("leg1", shifting, 0, reported).stance).toBeNull();
  });

  it("carries the base and all legs from where the rover is through a shift", () => {
    const { stance: half } = poseAt("leg1", shifting, 1, reported);
    expect(half?.base.position_m).toEqual([0.1, 0, 1]);
    expect(half?.base.orientation_xyzw[2]).toBeCloseTo(Math.sin(Math.PI / 8), 9);
    expect(half?.joints_rad).toEqual({ leg1: [0.25], leg2: [0.5] });
  });

  it("moves the stepping leg on the shifted body, and holds at the end", () => {
    const mid = poseAt("leg1", shifting, 3, reported);
    expect(mid.stance?.base.position_m).toEqual([0.2, 0, 1]);
    expect(mid.stance?.joints_rad).toEqual({ leg1: [1], leg2: [1] });
    expect(poseAt("leg1", shifting, 9, reported).stance?.joints_rad.leg1).toEqual([1.5]);
    const lift = [...shifting, { joints_rad: [2], time_s: 6 }, { joints_rad: [3], time_s: 8 }];
    const lifted = poseAt("leg1", lift, 7, reported);
    expect(lifted.stance?.base.position_m).toEqual([0.2, 0, 1]);
    expect(lifted.stance?.joints_rad).toEqual({ leg1: [2.5], leg2: [1] });
  });
});
