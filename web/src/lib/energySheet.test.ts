import { describe, expect, it } from "vitest";

import type { Vec2 } from "../api/types";
import {
  cividis,
  contoursOf,
  contourStep,
  type EnergyGrid,
  mostOf,
  readEnergy,
  sheetOf,
  surfaceResolution,
} from "./energySheet";

const TRIANGLE: Vec2[] = [
  [0, 0],
  [4, 0],
  [0, 4],
];

/** Distance from the slanted edge over the triangle, as a surface. */
function cone(step: number): EnergyGrid {
  const n = Math.round(4 / step) + 1;
  const height_m = Float32Array.from({ length: n * n }, (_, i) => {
    const [x, y] = [(i % n) * step, Math.floor(i / n) * step];
    return x + y <= 4 + 1e-9 ? 4 - x - y : NaN;
  });
  return { origin_m: [0, 0], resolution_m: step, size: [n, n], height_m };
}

function area(places: Vec2[]): number {
  let sum = 0;
  for (let t = 0; t + 2 < places.length; t += 3) {
    const [[ax, ay], [bx, by], [cx, cy]] = [places[t]!, places[t + 1]!, places[t + 2]!];
    sum += 0.5 * ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay));
  }
  return sum;
}

function encoded(values: number[]): string {
  const bytes = new Uint8Array(new Float32Array(values).buffer);
  return btoa(String.fromCharCode(...bytes));
}

describe("the energy surface", () => {
  it("is read from its message, and refused where it does not fit", () => {
    const surface = {
      origin_m: [1, 2] as Vec2,
      resolution_m: 0.5,
      size: [2, 1] as Vec2,
      height_m: encoded([0.25, NaN]),
    };
    const grid = readEnergy(surface);
    expect(grid.height_m[0]).toBe(0.25);
    expect(grid.height_m[1]).toBeNaN();
    expect(mostOf(grid)).toBe(0.25);
    expect(() => readEnergy({ ...surface, size: [2, 2] })).toThrow();
    expect(() => readEnergy({ ...surface, size: [0, 1] })).toThrow();
    expect(() => readEnergy({ ...surface, size: [1e6, 1e6] })).toThrow();
  });

  it("covers just the polygon, whatever the distance of its nodes", () => {
    for (const step of [1, 0.8, 0.3]) {
      expect(area(sheetOf(cone(step), TRIANGLE).places)).toBeCloseTo(8, 6);
    }
  });

  it("has contours where the margin is that of the line", () => {
    const ends = contoursOf(sheetOf(cone(0.5), TRIANGLE), 1);
    expect(ends.length).toBeGreaterThan(0);
    for (const [x, y] of ends.filter(([x, y]) => x > 0.01 && y > 0.01 && x + y < 3.4)) {
      const margin = 4 - x - y;
      expect(Math.abs(margin - Math.round(margin))).toBeLessThan(1e-6);
    }
  });

  it("is asked for finely enough for its polygon", () => {
    expect(surfaceResolution(TRIANGLE)).toBeCloseTo(4 / 56, 9);
    expect(surfaceResolution(TRIANGLE.map(([x, y]) => [x / 100, y / 100]))).toBe(0.02);
  });
});

describe("its scale", () => {
  it("goes from dark to bright and has about five lines", () => {
    const brightness = (share: number) => cividis(share).reduce((a, b) => a + b, 0);
    expect(brightness(0)).toBeLessThan(brightness(0.5));
    expect(brightness(0.5)).toBeLessThan(brightness(1));
    expect(cividis(7)).toEqual(cividis(1));
    expect(contourStep(1.08)).toBe(0.2);
    expect(contourStep(0.05)).toBe(0.01);
  });
});
