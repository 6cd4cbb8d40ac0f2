// What pairs would see of the ground, as classes that the ground shows.

import type { CoverageAnswer } from "../api/types";
import type { ClassStyle } from "../scene/palette";

export const COVERAGE: ClassStyle[] = [
  { value: 1, name: "by one pair", color: "#3f9db5", hatch: "none", strength: 0.5 },
  { value: 2, name: "by two or more", color: "#63d6bd", hatch: "none", strength: 0.55 },
  { value: 3, name: "hidden by a leg", color: "#b9a6e8", hatch: "cross", strength: 0.6 },
  { value: 0, name: "by none", color: "#2f3944", hatch: "rising", strength: 0.55 },
];

function bytesOf(base64: string): Uint8Array {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
}

export interface CoverageRaster {
  origin_m: [number, number];
  resolution_m: number;
  size: [number, number];
  classes: Uint8Array;
}

/** The classes of an answer; null where its masks do not have the length that it says. */
export function coverageRaster(answer: CoverageAnswer): CoverageRaster | null {
  const { origin_m, resolution_m, size } = answer;
  const count = size[0] * size[1];
  const mask = bytesOf(answer.mask_base64);
  const hidden = bytesOf(answer.hidden_base64);
  if (mask.length !== 2 * count || hidden.length !== count) return null;
  const classes = new Uint8Array(count);
  for (let i = 0; i < count; i++) {
    let bits = mask[2 * i]! | (mask[2 * i + 1]! << 8);
    let seen = 0;
    for (; bits !== 0 && seen < 2; bits &= bits - 1) seen += 1;
    classes[i] = seen > 0 ? seen : hidden[i]! > 0 ? 3 : 0;
  }
  return { origin_m, resolution_m, size, classes };
}

/** Least area that is worth a line (m²). */
const NAMED_M2 = 0.05;

/** What legs hide, as worth telling: `leg 3 hides 0.4 m²`. */
export function hiddenByLegs(answer: CoverageAnswer, legs: string[]) {
  return answer.hidden.filter(({ by, area_m2 }) => legs.includes(by) && area_m2 >= NAMED_M2);
}
