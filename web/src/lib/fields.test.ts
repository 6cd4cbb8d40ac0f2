import { expect, test } from "vitest";

import { fieldOf, fieldsOf, holds, preconditionWords, scalarOf, shownValue } from "./fields";

const MESSAGE = {
  mode: "idle",
  state: { joints_rad: { leg1: [0.1, -0.2] } },
  operation: { wheels: { leg1: { brake: true, heading_rad: null } } },
};

test("fields are found by names and indices, and null is none", () => {
  expect(fieldOf(MESSAGE, "mode")).toBe("idle");
  expect(fieldOf(MESSAGE, "state.joints_rad.leg1.1")).toBe(-0.2);
  expect(fieldOf(MESSAGE, "operation.wheels.leg1.brake")).toBe(true);
  for (const none of ["", "nose", "mode.length", "state.joints_rad.leg1.2", "toString"]) {
    expect(fieldOf(MESSAGE, none), none).toBeUndefined();
  }
  expect(fieldOf(MESSAGE, "state.joints_rad.leg1.length")).toBeUndefined();
  expect(fieldOf(MESSAGE, "operation.wheels.leg1.heading_rad")).toBeUndefined();
  expect(fieldOf(undefined, "mode")).toBeUndefined();
});

test("all fields that compare are listed", () => {
  expect(fieldsOf(MESSAGE)).toEqual([
    "mode",
    "state.joints_rad.leg1.0",
    "state.joints_rad.leg1.1",
    "operation.wheels.leg1.brake",
  ]);
  expect(fieldsOf(null)).toEqual([]);
});

test("what is typed is a number, a truth value or a text", () => {
  expect(["1.5", " -2 ", "true", "false", "idle", " "].map(scalarOf)).toEqual([
    1.5,
    -2,
    true,
    false,
    "idle",
    null,
  ]);
});

test("numbers have an order, texts and truth values are equal or not, kinds do not mix", () => {
  expect([holds(1, "lt", 2), holds(2, "le", 2), holds(2, "gt", 2), holds(2, "ge", 2)]).toEqual([
    true,
    true,
    false,
    true,
  ]);
  expect([holds("a", "eq", "a"), holds("a", "ne", "a"), holds(true, "ne", false)]).toEqual([
    true,
    false,
    true,
  ]);
  expect([holds("a", "lt", "b"), holds(1, "eq", "1"), holds(undefined, "eq", 1)]).toEqual([
    null,
    null,
    null,
  ]);
});

test("values are short", () => {
  expect([0.123456, 7, "idle", false, undefined, [1]].map(shownValue)).toEqual([
    "0.1235",
    "7",
    "idle",
    "false",
    "not told",
    "no single value",
  ]);
  const condition = {
    channel: "rover/state",
    field: "mode",
    op: "eq",
    value: "idle",
    max_age_s: 5,
  };
  expect(preconditionWords(condition as Parameters<typeof preconditionWords>[0])).toBe(
    "mode is idle",
  );
});
