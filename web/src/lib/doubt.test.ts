import { expect, test } from "vitest";

import { doubtOf } from "./doubt";

const doubt = { sigmas: 0.5, sigma_m: 0.03, step_m: 0.081, slope_rad: 0.1, class_as_seen: 3 };

test("what doubt changed is said with what may be there", () => {
  expect(doubtOf(doubt, 2)).toBe(
    "Looks safe; with ±1.5 cm of doubt its step may be 0.08 m, its slope 5.7°.",
  );
});

test("doubt that changes nothing is said to be counted", () => {
  expect(doubtOf(doubt, 3)).toBe("With ±1.5 cm of doubt counted");
});

test("a place between seen ones is not safe, and imported ground has no doubt", () => {
  expect(doubtOf({ ...doubt, sigma_m: null }, 2)).toBe(
    "Looks safe, but nobody saw this very place.",
  );
  expect(doubtOf({ ...doubt, sigma_m: null, class_as_seen: 1 }, 1)).toBeNull();
  expect(doubtOf({ ...doubt, sigma_m: 0 }, 3)).toBeNull();
});
