import { expect, test } from "vitest";

import type { CommandBody, CommandRecord } from "../api/types";
import { bodyWords, mayBeStep, moved, stepsOf } from "./sequence";

const record = (more: Partial<CommandRecord>) => ({ progress: 0, ...more }) as CommandRecord;
const states = (more: Partial<CommandRecord>) => stepsOf(record(more), 3).map((s) => s.state);

test("before it runs all steps wait, done all are done", () => {
  for (const state of ["staged", "armed", "sent", "received"] as const) {
    expect(states({ state })).toEqual(["waits", "waits", "waits"]);
  }
  expect(states({ state: "done", step: [3, 3] })).toEqual(["done", "done", "done"]);
});

test("the step under way has its own share: each counts alike", () => {
  const steps = stepsOf(record({ state: "executing", step: [2, 3], progress: 0.5 }), 3);
  expect(steps.map((s) => s.state)).toEqual(["done", "executing", "waits"]);
  expect(steps[1]!.share).toBeCloseTo(0.5);
});

test("the first that fails ends it: by the rover's word those after it are skipped", () => {
  const why = "step 2 of 3: a condition does not hold: x is 1, not 2; step 3 was not begun";
  const steps = stepsOf(record({ state: "failed", step: [1, 3], why }), 3);
  expect(steps.map((s) => s.state)).toEqual(["done", "failed", "skipped"]);
  expect(steps[1]!.why).toBe("a condition does not hold: x is 1, not 2");
  expect(steps[2]!.why).toBe("step 2 failed");
  const many = "step 1 of 3: why; steps 2 to 3 were not begun";
  expect(states({ state: "failed", why: many })).toEqual(["failed", "skipped", "skipped"]);
  const last = "step 3 of 3: why";
  expect(states({ state: "failed", why: last })).toEqual(["done", "done", "failed"]);
});

test("refused as a whole no step was begun", () => {
  const steps = stepsOf(record({ state: "failed", why: "the rover is stopped" }), 3);
  expect(steps.map((s) => s.state)).toEqual(["failed", "skipped", "skipped"]);
  expect(steps[2]!.why).toBe("the sequence did not begin");
});

test("aborted, the step under way was ended", () => {
  const why = "step 2 of 3: ended by an E-stop; step 3 was not begun";
  const steps = stepsOf(record({ state: "aborted", step: [2, 3], why }), 3);
  expect(steps.map((s) => s.state)).toEqual(["done", "failed", "skipped"]);
  expect(steps[2]!.why).toBe("step 2 was ended");
});

test("of an unknown outcome only what was told before is known", () => {
  expect(states({ state: "overdue" })).toEqual(["unknown", "unknown", "unknown"]);
  expect(states({ state: "overdue", step: [3, 3] })).toEqual(["done", "done", "unknown"]);
});

test("taken back or expired nothing was sent", () => {
  const steps = stepsOf(record({ state: "expired", why: "waited too long" }), 3);
  expect(steps.map((s) => [s.state, s.why])).toEqual(Array(3).fill(["skipped", "waited too long"]));
});

test("an item goes to another place, and nowhere beyond the ends", () => {
  const items = ["a", "b", "c"];
  expect(moved(items, 0, 1)).toEqual(["b", "a", "c"]);
  expect(moved(items, 2, 0)).toEqual(["c", "a", "b"]);
  expect(moved(items, 0, 3)).toEqual(items);
  expect(moved(items, -1, 0)).toEqual(items);
});

test("what stops is no step", () => {
  expect(mayBeStep({ type: "stop" })).toBe(false);
  expect(mayBeStep({ type: "sequence", steps: [] })).toBe(false);
  expect(mayBeStep({ type: "hold" })).toBe(true);
});

test.each<[CommandBody, string]>([
  [{ type: "wheel_brake", legs: [], on: true }, "Brake all wheels"],
  [{ type: "wheel_brake", legs: ["leg1", "leg2"], on: false }, "Release leg 1, leg 2"],
  [{ type: "wheel_roll", leg: "leg3", angle_rad: Math.PI / 2 }, "Roll the wheel of leg 3 by 90°"],
  [{ type: "wheel_steer", headings_rad: { leg1: -Math.PI / 6 } }, "Steer leg 1 to −30°"],
  [{ type: "mode", mode: "driving" }, "Mode driving"],
])("%o is %s", (body, words) => {
  expect(bodyWords(body)).toBe(words);
});
