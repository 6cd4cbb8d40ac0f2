// The pose of a plan at a time: the joints of its leg, and the whole rover where the body shifts.

import type { PlanAnswer, Quat, RoverState, Vec3 } from "../api/types";
import { jointsAt } from "./step";

export interface PlanPose {
  leg: string;
  joints_rad: number[];
  /** The whole rover, or null where its body stands as reported. */
  stance: RoverState | null;
}

type Waypoint = Pick<PlanAnswer["waypoints"][number], "joints_rad" | "time_s" | "stance">;

/** The plan's pose `t` seconds after its start; before a first stance the rover is as `reported`. */
export function poseAt(
  leg: string,
  waypoints: Waypoint[],
  t: number,
  reported: RoverState | null,
): PlanPose {
  const joints_rad = jointsAt(waypoints, t);
  if (!waypoints.some((w) => w.stance)) return { leg, joints_rad, stance: null };
  const found = waypoints.findIndex((w) => w.time_s >= t);
  const i = found < 0 ? waypoints.length - 1 : found;
  const b = waypoints[i]!;
  const a = waypoints[i - 1] ?? b;
  // What was shifted stays shifted.
  const shifted = waypoints.slice(0, i).findLast((w) => w.stance)?.stance;
  const from = shifted ?? reported;
  const to = b.stance ?? from;
  if (!shifted && !b.stance) return { leg, joints_rad, stance: null };
  if (!from || !to) return { leg, joints_rad, stance: to ?? null };
  const span = b.time_s - a.time_s;
  const s = span > 0 ? Math.min(1, Math.max(0, (t - a.time_s) / span)) : 1;
  const stance = between(from, to, s);
  return {
    leg,
    joints_rad,
    stance: { ...stance, joints_rad: { ...stance.joints_rad, [leg]: joints_rad } },
  };
}

/** Between two states of the rover, `s` of the way from `a` to `b`. */
export function between(a: RoverState, b: RoverState, s: number): RoverState {
  const mix = (from: number[], to: number[]) => from.map((v, k) => v + s * ((to[k] ?? v) - v));
  const joints_rad = Object.fromEntries(
    Object.entries(b.joints_rad).map(([leg, q]) => [leg, mix(a.joints_rad[leg] ?? q, q)]),
  );
  return {
    ...b,
    base: {
      position_m: mix(a.base.position_m, b.base.position_m) as Vec3,
      orientation_xyzw: turned(a.base.orientation_xyzw, b.base.orientation_xyzw, s),
    },
    joints_rad,
  };
}

/** A body shift turns the body by little, for which the chord is the arc. */
function turned(a: Quat, b: Quat, s: number): Quat {
  const side = a.reduce((sum, v, k) => sum + v * b[k]!, 0) < 0 ? -1 : 1;
  const q = a.map((v, k) => v + s * (side * b[k]! - v));
  const length = Math.hypot(...q);
  return q.map((v) => v / length) as Quat;
}
