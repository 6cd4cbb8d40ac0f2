// The energy margin along a line from the center of mass, as a curve to be drawn.

import type { EnergySlice } from "../api/types";

export interface SlicePoint {
  /** Way of the center of mass (m). */
  at_m: number;
  /** Rise that would tip the rover there (m). */
  rise_m: number;
}

/** From the center of mass to where nothing is left to rise: beyond, the rover tips by itself. */
export function slicePoints({ length_m, height_m }: EnergySlice): SlicePoint[] {
  const n = height_m.length;
  if (n < 2 || !(length_m >= 0)) return [];
  const all = height_m.map((rise_m, i) => ({ at_m: (i / (n - 1)) * length_m, rise_m }));
  const beyond = all.findIndex((p) => p.rise_m <= 0);
  if (beyond < 1) return beyond === 0 ? [] : all;
  const [a, b] = [all[beyond - 1]!, all[beyond]!];
  const s = a.rise_m / (a.rise_m - b.rise_m);
  return [...all.slice(0, beyond), { at_m: a.at_m + s * (b.at_m - a.at_m), rise_m: 0 }];
}

/** A round end of an axis that holds a value. */
export function roundUp(value: number): number {
  const steps = [0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 5, 7.5, 10];
  return steps.find((s) => s >= value) ?? Math.ceil(value / 10) * 10;
}

/** A heading from the rover's forward direction (rad) in words: `ahead`, `30° to the left`. */
export function headingWords(heading_rad: number): string {
  const degrees = Math.round((heading_rad * 180) / Math.PI);
  if (degrees === 0) return "ahead";
  if (Math.abs(degrees) === 180) return "back";
  return `${Math.abs(degrees)}° to the ${degrees > 0 ? "left" : "right"}`;
}

/** Yaw of a unit quaternion `[x, y, z, w]` (rad). */
export function yawOf([x, y, z, w]: readonly number[]): number {
  return Math.atan2(2 * (w! * z! + x! * y!), 1 - 2 * (y! * y! + z! * z!));
}
