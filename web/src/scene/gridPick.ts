// Where a ray meets the ground: a walk from cell to cell along the ray, no triangles stored.

import type { Vec3 } from "../api/types";
import type { HeightRaster } from "./heightRaster";

export interface Ray {
  origin: Vec3;
  /** Any length but zero. */
  direction: Vec3;
}

/** First point of the ground on the ray, or null. Each cell is two triangles split from (1,0) to (0,1). */
export function pickGround(raster: HeightRaster, ray: Ray): Vec3 | null {
  const { origin_m, resolution_m, size } = raster.shape;
  // Work in grid coordinates: cells have side 1 in u and v; t is the same along the ray.
  const ou = (ray.origin[0] - origin_m[0]) / resolution_m;
  const ov = (ray.origin[1] - origin_m[1]) / resolution_m;
  const du = ray.direction[0] / resolution_m;
  const dv = ray.direction[1] / resolution_m;
  const [oz, dz] = [ray.origin[2], ray.direction[2]];

  const span: [number, number] = [0, Infinity];
  if (!clip(span, ou, du, 0, size[0] - 1)) return null;
  if (!clip(span, ov, dv, 0, size[1] - 1)) return null;
  if (!clip(span, oz, dz, raster.z_min_m - 1e-6, raster.z_max_m + 1e-6)) return null;

  const end = span[1];
  let t = span[0];
  let i = clampCell(Math.floor(ou + t * du), size[0]);
  let j = clampCell(Math.floor(ov + t * dv), size[1]);
  const [stepU, stepV] = [Math.sign(du), Math.sign(dv)];
  const deltaU = du === 0 ? Infinity : Math.abs(1 / du);
  const deltaV = dv === 0 ? Infinity : Math.abs(1 / dv);
  let nextU = du === 0 ? Infinity : (i + (stepU > 0 ? 1 : 0) - ou) / du;
  let nextV = dv === 0 ? Infinity : (j + (stepV > 0 ? 1 : 0) - ov) / dv;

  while (t <= end) {
    const leave = Math.min(nextU, nextV, end);
    const hit = pickCell(raster, i, j, [ou, ov, oz], [du, dv, dz], t, leave);
    if (hit !== null) {
      return [
        ray.origin[0] + hit * ray.direction[0],
        ray.origin[1] + hit * ray.direction[1],
        oz + hit * dz,
      ];
    }
    if (leave >= end) return null;
    t = leave;
    if (nextU < nextV) {
      i += stepU;
      nextU += deltaU;
      if (i < 0 || i > size[0] - 2) return null;
    } else {
      j += stepV;
      nextV += deltaV;
      if (j < 0 || j > size[1] - 2) return null;
    }
  }
  return null;
}

function clampCell(index: number, nodes: number): number {
  return Math.min(Math.max(index, 0), nodes - 2);
}

/** Narrows `span` to where origin + t·direction lies in [low, high]; false if nowhere. */
function clip(
  span: [number, number],
  origin: number,
  direction: number,
  low: number,
  high: number,
): boolean {
  if (direction === 0) return origin >= low && origin <= high;
  const a = (low - origin) / direction;
  const b = (high - origin) / direction;
  span[0] = Math.max(span[0], Math.min(a, b));
  span[1] = Math.min(span[1], Math.max(a, b));
  return span[0] <= span[1];
}

const EDGE = 1e-9;

/** The ray's parameter where it meets the cell's surface within [t0, t1], or null. */
function pickCell(
  raster: HeightRaster,
  i: number,
  j: number,
  o: Vec3,
  d: Vec3,
  t0: number,
  t1: number,
): number | null {
  const w = raster.shape.size[0];
  const at = j * w + i;
  const z00 = raster.heights[at]!;
  const z10 = raster.heights[at + 1]!;
  const z01 = raster.heights[at + w]!;
  const z11 = raster.heights[at + w + 1]!;
  const [za, zb] = [o[2] + t0 * d[2], o[2] + t1 * d[2]];
  if (Math.min(za, zb) > Math.max(z00, z10, z01, z11)) return null;
  if (Math.max(za, zb) < Math.min(z00, z10, z01, z11)) return null;

  // Plane z = c + a·u + b·v of each triangle, u and v within the cell.
  const lower = solve(z00, z10 - z00, z01 - z00, i, j, o, d);
  const upper = solve(z10 + z01 - z11, z11 - z01, z11 - z10, i, j, o, d);
  let best: number | null = null;
  for (const [t, side] of [
    [lower, 1],
    [upper, -1],
  ] as const) {
    if (t === null || t < t0 - EDGE || t > t1 + EDGE) continue;
    const u = o[0] + t * d[0] - i;
    const v = o[1] + t * d[1] - j;
    const inTriangle = side * (1 - u - v) >= -EDGE;
    const inCell = u >= -EDGE && v >= -EDGE && u <= 1 + EDGE && v <= 1 + EDGE;
    if (inTriangle && inCell && (best === null || t < best)) best = t;
  }
  return best;
}

function solve(c: number, a: number, b: number, i: number, j: number, o: Vec3, d: Vec3) {
  const slope = d[2] - a * d[0] - b * d[1];
  if (slope === 0) return null;
  return (c + a * (o[0] - i) + b * (o[1] - j) - o[2]) / slope;
}
