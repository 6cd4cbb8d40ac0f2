// Loads of the feet on one scale: measured beside predicted.

import type { Vec3 } from "../api/types";

const ROUND_N = [10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000];

/** End of the scale (N) that all legs share: round, and above everything on it. */
export function fullScale(
  measured_n: Record<string, Vec3>,
  bands_n: Record<string, Vec3> | null,
): number {
  const measured = Object.values(measured_n).map((force) => force[2]);
  const most = Object.values(bands_n ?? {}).map((band) => band[2]);
  const top = Math.max(1, ...[...measured, ...most].filter(Number.isFinite));
  return ROUND_N.find((n) => n >= top) ?? top;
}

/** Outside of the band by more than a hundredth of the scale, which can be seen. */
export function isOutside(measured_n: number, [least, , most]: Vec3, full_n: number): boolean {
  const slack = 0.01 * full_n;
  return measured_n < least - slack || measured_n > most + slack;
}
