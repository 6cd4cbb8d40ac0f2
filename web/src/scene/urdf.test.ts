import { describe, expect, it } from "vitest";

import type { RoverModel, RoverState } from "../api/types";
import { expandCapsules, poseRobot, readUrdf, wheelCenter } from "./urdf";

// One leg: yaw about z at (1, 0, 0), pitch about y 0.5 m further out, the wheel 2 m beyond.
const URDF = `<?xml version="1.0"?>
<robot name="one">
  <link name="chassis"><visual><geometry><box size="1 1 0.2"/></geometry></visual></link>
  <link name="a"/><link name="b">
    <visual><origin xyz="1 0 0" rpy="0 1.5707963267948966 0"/>
      <geometry><capsule radius="0.1" length="2"/></geometry></visual>
    <visual><geometry><mesh filename="package://nowhere/part.stl"/></geometry></visual>
  </link>
  <link name="wheel"><visual><geometry><cylinder radius="0.3" length="0.2"/></geometry></visual></link>
  <joint name="yaw" type="revolute"><parent link="chassis"/><child link="a"/>
    <origin xyz="1 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="pitch" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="spin" type="continuous"><parent link="b"/><child link="wheel"/>
    <origin xyz="2 0 0"/><axis xyz="0 1 0"/></joint>
</robot>`;

const model = {
  scale: 1,
  legs: [{ name: "leg1", joints: ["yaw", "pitch"], wheel_link: "wheel", wheel_joint: "spin" }],
} as unknown as RoverModel;

function state(joints: number[], position: [number, number, number], yaw = 0): RoverState {
  return {
    base: {
      position_m: position,
      orientation_xyzw: [0, 0, Math.sin(yaw / 2), Math.cos(yaw / 2)],
    },
    joints_rad: { leg1: joints },
  };
}

function wheel(of: RoverState, scale = 1): number[] {
  const robot = readUrdf(URDF);
  poseRobot(robot, { ...model, scale }, of);
  return wheelCenter(robot, model, "leg1")!;
}

function near(found: number[], expected: number[]): void {
  expected.forEach((v, k) => expect(found[k]).toBeCloseTo(v, 9));
}

describe("the robot is posed as the state says", () => {
  it("stretched out along x", () => {
    near(wheel(state([0, 0], [0, 0, 0])), [3.5, 0, 0]);
  });

  it("a positive pitch lowers the leg, a yaw turns it to the left", () => {
    // Pitch 90 degrees: the last 2 m point down. Yaw 30 degrees turns the 0.5 m before it.
    const [c, s] = [Math.cos(Math.PI / 6), Math.sin(Math.PI / 6)];
    near(wheel(state([Math.PI / 6, Math.PI / 2], [0, 0, 0])), [1 + 0.5 * c, 0.5 * s, -2]);
  });

  it("the base carries all of it, and the picture ignores joint limits", () => {
    // Base turned by 90 degrees: x becomes y. Yaw of 180 degrees is beyond the limit of 1 rad.
    near(wheel(state([Math.PI, 0], [10, 20, 3], Math.PI / 2)), [10, 20 + 1 - 2.5, 3]);
  });

  it("scale multiplies lengths of the robot, not where it is", () => {
    near(wheel(state([0, 0], [1, 2, 3]), 2), [1 + 7, 2, 3]);
  });
});

describe("capsules", () => {
  it("become a cylinder and two spheres at its ends", () => {
    const document = new DOMParser().parseFromString(URDF, "application/xml");
    expandCapsules(document);
    expect(document.getElementsByTagName("capsule").length).toBe(0);
    const spheres = [...document.getElementsByTagName("sphere")];
    const places = spheres.map((s) => {
      const origin = s.parentElement!.parentElement!.getElementsByTagName("origin")[0]!;
      return origin.getAttribute("xyz")!.split(" ").map(Number);
    });
    // The capsule lies along x from 0 to 2.
    near(places[0]!, [0, 0, 0]);
    near(places[1]!, [2, 0, 0]);
  });
});
