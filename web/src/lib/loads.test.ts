import { describe, expect, it } from "vitest";

import { fullScale, isOutside } from "./loads";

describe("loads on one scale", () => {
  it("end at a round number above all of them", () => {
    expect(fullScale({ leg1: [0, 0, 312] }, { leg1: [140, 312, 497] })).toBe(500);
    expect(fullScale({ leg1: [0, 0, 90] }, null)).toBe(100);
    expect(fullScale({}, null)).toBe(10);
  });

  it("are outside of their band only where that can be seen", () => {
    expect(isOutside(495, [100, 300, 500], 1000)).toBe(false);
    expect(isOutside(505, [100, 300, 500], 1000)).toBe(false);
    expect(isOutside(520, [100, 300, 500], 1000)).toBe(true);
    expect(isOutside(0, [100, 300, 500], 1000)).toBe(true);
  });
});
