// The kinds of support regions, told in one shape whatever message they come from.

import type { PolygonAnswer, StabilityDerived, Vec2 } from "../api/types";
import { capital } from "./format";

export const REGION_KEYS = [
  "regular",
  "conservative",
  "friction",
  "frictionLoss",
  "torque",
] as const;
export type RegionKey = (typeof REGION_KEYS)[number];

export interface Region {
  key: RegionKey;
  /** `unknown` where the message does not tell. */
  kind: "area" | "point" | "empty" | "unknown";
  polygon: PolygonAnswer | null;
  whyEmpty: string | null;
  /** Feet that push against each other carry it this far. */
  capped: boolean;
}

const unknown = (key: RegionKey): Region => ({
  key,
  kind: "unknown",
  polygon: null,
  whyEmpty: null,
  capped: false,
});

const FEW_FEET = "Fewer than three feet stand apart";
const NONE_KEEPS = "No place is safe whichever foot slips";

export function regionOf(stability: StabilityDerived | null, key: RegionKey): Region {
  if (!stability) return unknown(key);
  if (key === "regular") {
    const polygon = stability.regular ?? null;
    const whyEmpty = polygon ? null : FEW_FEET;
    return { key, kind: polygon ? "area" : "empty", polygon, whyEmpty, capped: false };
  }
  if (key === "conservative") {
    const kind = stability.conservative_kind;
    const whyEmpty = kind !== "empty" ? null : stability.regular ? NONE_KEEPS : FEW_FEET;
    return { key, kind, polygon: stability.conservative ?? null, whyEmpty, capped: false };
  }
  const { forces } = stability;
  if (!forces) return unknown(key);
  const answers = {
    friction: forces.friction,
    frictionLoss: forces.friction_conservative,
    torque: forces.torque,
  };
  const { kind, region = null, why_empty = null, capped = false } = answers[key];
  return { key, kind, polygon: region, whyEmpty: why_empty && capital(why_empty), capped };
}

export const regionsOf = (stability: StabilityDerived | null): Region[] =>
  REGION_KEYS.map((key) => regionOf(stability, key));

/** The legs that a `critical` of the server names: `leg2 and leg3`, or `leg1, leg2, leg4`. */
export function feetOf(critical: string | null | undefined): string[] {
  return (critical ?? "").split(/,\s*|\s+and\s+/).filter((foot) => foot !== "");
}

/** `legs 2–3` for the two ends of an edge, `legs 1, 2, 4` for more; `n_standing` of them are all. */
export function feetLabel(feet: string[], n_standing = Infinity): string {
  if (feet.length === 0) return "";
  if (feet.length > 2 && feet.length >= n_standing) return "all feet";
  const numbers = feet.map((foot) => /^leg(\d+)$/.exec(foot)?.[1]);
  const numbered = numbers.every((n) => n !== undefined);
  const names = numbered ? (numbers as string[]) : feet;
  const word = numbered ? (feet.length === 1 ? "leg " : "legs ") : "";
  return word + names.join(names.length === 2 ? "–" : ", ");
}

/** Outlines nearer than this are drawn beside each other (m). */
const TOGETHER_M = 0.03;
const BESIDE_M = 0.05;

/** Whether two regions are the same to the eye. */
export function coincide(a: Vec2[], b: Vec2[]): boolean {
  const on = (of: Vec2[], other: Vec2[]) => of.every((p) => fromOutline(p, other) < TOGETHER_M);
  return on(a, b) && on(b, a);
}

/**
 * Moves a place of an outline inward where other outlines run, so that lines that would hide each other
 * run side by side; where regions differ they are drawn where they are.
 */
export function beside(place: Vec2, outline: Vec2[], others: Vec2[][]): Vec2 {
  const shared = others.filter((other) => fromOutline(place, other) < TOGETHER_M).length;
  if (shared === 0) return place;
  const n = outline.length;
  const middle = outline.reduce<Vec2>((m, p) => [m[0] + p[0] / n, m[1] + p[1] / n], [0, 0]);
  const [dx, dy] = [middle[0] - place[0], middle[1] - place[1]];
  const far = Math.hypot(dx, dy);
  const step = Math.min(shared * BESIDE_M, 0.5 * far);
  return far === 0 ? place : [place[0] + (dx / far) * step, place[1] + (dy / far) * step];
}

function fromOutline([x, y]: Vec2, outline: Vec2[]): number {
  return outline.reduce((least, [ax, ay], i) => {
    const [bx, by] = outline[(i + 1) % outline.length]!;
    const [dx, dy] = [bx - ax, by - ay];
    const length2 = dx * dx + dy * dy;
    const s = length2 > 0 ? ((x - ax) * dx + (y - ay) * dy) / length2 : 0;
    const t = Math.min(1, Math.max(0, s));
    return Math.min(least, Math.hypot(x - ax - t * dx, y - ay - t * dy));
  }, Infinity);
}
