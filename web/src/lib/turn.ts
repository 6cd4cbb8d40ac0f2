// Turning a wheel about the point where it touches the ground.

import type { Vec3 } from "../api/types";

/** About what a wheel is turned: upright, along where it heads (it leans), or along its axle (its fork pitches). */
export type TurnAxis = "up" | "heading" | "axle";

/** The axis in `world`, for a wheel that heads there (rad, counter-clockwise from x of `world`). */
export function axisOf(axis: TurnAxis, heading_rad: number): Vec3 {
  if (axis === "up") return [0, 0, 1];
  const [c, s] = [Math.cos(heading_rad), Math.sin(heading_rad)];
  // The axle points to the left of where the wheel heads.
  return axis === "heading" ? [c, s, 0] : [-s, c, 0];
}

/** Rotation of a vector about a unit axis (Rodrigues). */
export function rotated(v: Vec3, axis: Vec3, angle_rad: number): Vec3 {
  const [c, s] = [Math.cos(angle_rad), Math.sin(angle_rad)];
  const along = axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2];
  const across: Vec3 = [
    axis[1] * v[2] - axis[2] * v[1],
    axis[2] * v[0] - axis[0] * v[2],
    axis[0] * v[1] - axis[1] * v[0],
  ];
  return v.map((x, i) => x * c + across[i]! * s + axis[i]! * along * (1 - c)) as Vec3;
}

/** Where the center of a wheel goes (m, from where it is) and how it turns when its contact stays. */
export function aboutContact(
  center: Vec3,
  contact: Vec3,
  axis: Vec3,
  angle_rad: number,
): { position_m: Vec3; rotation_rad: Vec3 } {
  const arm = center.map((v, i) => v - contact[i]!) as Vec3;
  const to = rotated(arm, axis, angle_rad);
  return {
    position_m: to.map((v, i) => v - arm[i]!) as Vec3,
    rotation_rad: axis.map((v) => v * angle_rad) as Vec3,
  };
}

/** Heading (rad) of a base's x in plan, from its orientation. */
export function headingOf([x, y, z, w]: readonly number[] & { length: 4 }): number {
  return Math.atan2(2 * (w! * z! + x! * y!), 1 - 2 * (y! * y! + z! * z!));
}
