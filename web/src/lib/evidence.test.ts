import { expect, test } from "vitest";

import type { CommandRecord, RoverTelemetry, Vec3 } from "../api/types";
import { evidenceOf, heardSince, lastStage, type Shown } from "./evidence";

const telemetry = {
  mode: "idle",
  state: { joints_rad: { leg1: [0, 0.5], leg2: [0, 0] } },
  operation: {
    mode: "driving",
    wheels: { leg1: { brake: false, spin_rad_s: 0 }, leg2: { brake: true, spin_rad_s: 0 } },
  },
} as unknown as RoverTelemetry;
const legs = [{ name: "leg1", joints: ["leg1_yaw", "leg1_pitch"] }] as Shown["legs"];
const shown: Shown = { telemetry, legs, wheel: () => [1, 2, 3] as Vec3 };
const fits = (body: CommandRecord["body"]) => evidenceOf(body, shown).fits;
const path = (...joints_rad: number[][]) => ({
  type: "joint_path" as const,
  leg: "leg1",
  knots: joints_rad.map((q, i) => ({ joints_rad: q, time_s: i })),
});

test("a leg at the end of its path, at its beginning, and in between", () => {
  expect(fits(path([0, 0], [0, 0.5]))).toBe("done");
  expect(fits(path([0, 0.5], [0, 0.9]))).toBe("not_done");
  expect(fits(path([0, 0.2], [0, 0.9]))).toBe("neither");
  const { text } = evidenceOf(path([0, 0.5 - Math.PI / 18], [0, 0.5 + Math.PI / 9]), shown);
  expect(text).toBe("Leg 1 is 20.0° from where the command ends, 10.0° from where it begins.");
});

test("a path that goes nowhere tells nothing", () => {
  expect(fits(path([0, 0.5], [0, 0.5]))).toBe("unknown");
});

test("a shift of the body goes by its furthest leg", () => {
  const knot = (q: number, time_s: number) => ({
    joints_rad: { leg1: [0, 0.5], leg2: [q, 0] },
    time_s,
  });
  expect(fits({ type: "body_path", knots: [knot(0.3, 0), knot(0, 1)] })).toBe("done");
  expect(fits({ type: "body_path", knots: [knot(0, 0), knot(0.3, 1)] })).toBe("not_done");
});

test("wheels, joints, modes and brakes", () => {
  expect(fits({ type: "wheel_line", leg: "leg1", position_m: [1, 2, 3.005] })).toBe("done");
  expect(fits({ type: "wheel_line", leg: "leg1", position_m: [1, 2, 3.5] })).toBe("not_there");
  expect(fits({ type: "joint_move", joints_rad: { leg1_pitch: 0.5 } })).toBe("done");
  expect(fits({ type: "joint_move", joints_rad: { leg1_pitch: 0.6 } })).toBe("not_there");
  expect(fits({ type: "joint_move", joints_rad: { leg9_pitch: 0.5 } })).toBe("unknown");
  expect(fits({ type: "mode", mode: "driving" })).toBe("done");
  expect(fits({ type: "mode", mode: "safe" })).toBe("not_done");
  expect(fits({ type: "wheel_brake", legs: ["leg1"], on: false })).toBe("done");
  expect(fits({ type: "wheel_brake", legs: ["leg2"], on: false })).toBe("not_done");
  expect(fits({ type: "wheel_brake", legs: [], on: true })).toBe("neither");
  expect(fits({ type: "drive_arc", distance_m: 1, turn_rad: 0, course_rad: 0 })).toBe("unknown");
});

test("the last stage that is known", () => {
  const stage = (stage: string, outcome: string) => ({ stage, outcome });
  const command = (...verification: object[]) => ({ verification }) as CommandRecord;
  expect(lastStage(command())).toBe("nothing is verified");
  expect(lastStage(command(stage("released", "ok"), stage("transmitted", "unknown")))).toMatch(
    /nobody knows whether it was transmitted/,
  );
  expect(
    lastStage(
      command(stage("released", "ok"), stage("transmitted", "ok"), stage("received", "timeout")),
    ),
  ).toMatch(/has not said that it has it/);
});

test("telemetry counts from when the command would have reached the rover", () => {
  const command = { arrives: "2026-11-23T12:00:10Z" } as CommandRecord;
  const at = (text: string) => Date.parse(text);
  expect(heardSince(command, at("2026-11-23T12:00:09Z"))).toBeNull();
  expect(heardSince(command, at("2026-11-23T12:00:14Z"))).toBe(4);
  expect(heardSince(command, null)).toBeNull();
  expect(heardSince({} as CommandRecord, at("2026-11-23T12:00:14Z"))).toBeNull();
});
