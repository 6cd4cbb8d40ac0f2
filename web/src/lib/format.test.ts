import { describe, expect, it } from "vitest";

import { degrees, metres, readable } from "./format";

describe("numbers", () => {
  it("have fixed decimals, a true minus, and no minus before zero", () => {
    expect([metres(1), metres(-0.256), metres(-0.001), metres(null), metres(NaN)]).toEqual([
      "1.00 m",
      "−0.26 m",
      "0.00 m",
      "–",
      "–",
    ]);
    expect(degrees(Math.PI / 6)).toBe("30.0°");
  });
});

describe("sentences of the server", () => {
  it.each([
    ["leg1_hip_pitch_link and the ground at 3.2 s", "leg 1 hip pitch and the ground at 3.2 s"],
    ["Lift leg2", "Lift leg 2"],
    ["the rover's body has moved", "the rover's body has moved"],
    ["between leg2 and leg3", "between leg 2 and leg 3"],
  ])("%s", (text, expected) => expect(readable(text)).toBe(expected));
});
