// Which leg a ray meets: each leg counts as a chain of capsules, its wheel as a sphere.

import type { Vec3 } from "../api/types";
import type { Ray } from "./gridPick";

export interface LegShape {
  leg: string;
  /** Points from the hip to the wheel's center. */
  points: Vec3[];
  wheel_radius_m: number;
}

const LIMB_RADIUS_M = 0.16;

/** The nearest leg on the ray and how far along it (in lengths of the direction), or null. */
export function pickLeg(legs: LegShape[], ray: Ray): { leg: string; t: number } | null {
  let best: { leg: string; t: number } | null = null;
  for (const { leg, points, wheel_radius_m } of legs) {
    for (let k = 0; k < points.length; k++) {
      const last = k === points.length - 1;
      const t = last
        ? meet(ray, points[k]!, points[k]!, wheel_radius_m)
        : meet(ray, points[k]!, points[k + 1]!, LIMB_RADIUS_M);
      if (t !== null && (best === null || t < best.t)) best = { leg, t };
    }
  }
  return best;
}

const sub = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Vec3, b: Vec3) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Where the ray is nearest to the segment, if that is nearer than `radius`. */
function meet(ray: Ray, a: Vec3, b: Vec3, radius: number): number | null {
  const d = ray.direction;
  const e = sub(b, a);
  const r = sub(ray.origin, a);
  const [dd, ee, de] = [dot(d, d), dot(e, e), dot(d, e)];
  const [dr, er] = [dot(d, r), dot(e, r)];
  const det = dd * ee - de * de;
  let s = ee > 0 ? (det > 1e-12 ? (dd * er - de * dr) / det : er / ee) : 0;
  s = Math.min(1, Math.max(0, s));
  const t = (s * de - dr) / dd;
  if (t <= 0) return null;
  const gap: Vec3 = [
    r[0] + t * d[0] - s * e[0],
    r[1] + t * d[1] - s * e[1],
    r[2] + t * d[2] - s * e[2],
  ];
  return dot(gap, gap) <= radius * radius ? t : null;
}
