import { describe, expect, it } from "vitest";

import type { Vec3 } from "../api/types";
import { pickGround, type Ray } from "./gridPick";
import { HeightRaster } from "./heightRaster";

/** Seeded numbers in [0, 1): the test is the same each time. */
function numbers(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

function rough(seed: number, size: [number, number], resolution_m: number): HeightRaster {
  const next = numbers(seed);
  const raster = new HeightRaster({ origin_m: [-3, 5], resolution_m, size });
  for (let i = 0; i < raster.heights.length; i++) raster.heights[i] = 1.5 * next();
  return raster.finish();
}

const sub = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const dot = (a: Vec3, b: Vec3) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Möller and Trumbore. */
function hitTriangle(ray: Ray, a: Vec3, b: Vec3, c: Vec3): number | null {
  const [e1, e2] = [sub(b, a), sub(c, a)];
  const p = cross(ray.direction, e2);
  const det = dot(e1, p);
  if (Math.abs(det) < 1e-12) return null;
  const s = sub(ray.origin, a);
  const u = dot(s, p) / det;
  const q = cross(s, e1);
  const v = dot(ray.direction, q) / det;
  if (u < 0 || v < 0 || u + v > 1) return null;
  const t = dot(e2, q) / det;
  return t >= 0 ? t : null;
}

function everyTriangle(raster: HeightRaster, ray: Ray): number | null {
  const { origin_m, resolution_m, size } = raster.shape;
  const node = (i: number, j: number): Vec3 => [
    origin_m[0] + i * resolution_m,
    origin_m[1] + j * resolution_m,
    raster.heights[j * size[0] + i]!,
  ];
  let best: number | null = null;
  for (let j = 0; j < size[1] - 1; j++) {
    for (let i = 0; i < size[0] - 1; i++) {
      const [a, b, c, d] = [node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1)];
      for (const t of [hitTriangle(ray, a, b, c), hitTriangle(ray, b, d, c)]) {
        if (t !== null && (best === null || t < best)) best = t;
      }
    }
  }
  return best;
}

describe("the grid walk finds the same point as testing every triangle", () => {
  it.each([1, 2, 3])("on rough ground, seed %i", (seed) => {
    const raster = rough(seed, [23, 17], 0.4);
    const next = numbers(1000 + seed);
    let hits = 0;
    for (let n = 0; n < 3000; n++) {
      const origin: Vec3 = [-8 + 18 * next(), 1 + 16 * next(), -1 + 6 * next()];
      const target: Vec3 = [-4 + 11 * next(), 4 + 8 * next(), 1.5 * next()];
      const direction = sub(target, origin);
      const ray = { origin, direction };
      const expected = everyTriangle(raster, ray);
      const found = pickGround(raster, ray);
      if (expected === null || found === null) {
        expect([n, found]).toEqual([n, expected === null ? null : "a hit"]);
        continue;
      }
      hits += 1;
      const point = origin.map((o, k) => o + expected * direction[k]!);
      point.forEach((v, k) => expect(found[k]).toBeCloseTo(v, 5));
    }
    expect(hits).toBeGreaterThan(1500);
  });

  it("straight down and along the axes", () => {
    const raster = rough(9, [12, 12], 1);
    const down = pickGround(raster, { origin: [-3 + 4, 5 + 7, 9], direction: [0, 0, -1] });
    expect(down?.[2]).toBeCloseTo(raster.heights[7 * 12 + 4]!, 6);
    for (const direction of [
      [1, 0, -0.2],
      [0, 1, -0.2],
      [-1, 0, -0.1],
    ] as Vec3[]) {
      const ray: Ray = { origin: [2.3, 10.4, 2], direction };
      const expected = everyTriangle(raster, ray);
      const found = pickGround(raster, ray);
      expect(found === null).toBe(expected === null);
      if (found && expected !== null) expect(found[2]).toBeCloseTo(2 + expected * direction[2], 6);
    }
  });

  it("looks past the map and away from it", () => {
    const raster = rough(4, [8, 8], 1);
    expect(pickGround(raster, { origin: [50, 50, 5], direction: [1, 0, -0.1] })).toBeNull();
    expect(pickGround(raster, { origin: [0, 8, 5], direction: [0, 0, 1] })).toBeNull();
  });
});

describe("the height raster", () => {
  it("fills what is unknown for the mesh but does not call it known", () => {
    const raster = new HeightRaster({ origin_m: [0, 0], resolution_m: 1, size: [3, 2] });
    raster.heights.set([1, NaN, 3, NaN, NaN, NaN]);
    raster.finish();
    expect([...raster.heights].every(Number.isFinite)).toBe(true);
    expect([...raster.known]).toEqual([1, 0, 1, 0, 0, 0]);
    expect(raster.knownAt(1.2, 0)).toBe(false);
    expect(raster.knownAt(0.2, 0.3)).toBe(true);
  });

  it("interpolates between nodes and is NaN outside", () => {
    const raster = new HeightRaster({ origin_m: [10, 20], resolution_m: 0.5, size: [2, 2] });
    raster.heights.set([0, 1, 2, 3]);
    raster.finish();
    expect(raster.heightAt(10.25, 20.25)).toBeCloseTo(1.5, 12);
    expect(raster.heightAt(10.5, 20.5)).toBe(3);
    expect(raster.heightAt(10.6, 20)).toBeNaN();
  });

  it("leaves out what a tile holds beyond the map", () => {
    const raster = new HeightRaster({ origin_m: [0, 0], resolution_m: 1, size: [2, 2] });
    const header = { origin_m: [-1, 0], size: [4, 1], resolution_m: 1 } as never;
    raster.place({ header, values: Float32Array.from([9, 1, 2, 9]) });
    raster.finish();
    expect([...raster.heights]).toEqual([1, 2, 1, 2]);
  });
});
