// What doubt of the heights does to the class of a place, in words.

import type { CellAnswer } from "../api/types";
import { TRAVERSABILITY } from "../scene/palette";
import { degrees, metres } from "./format";

type Doubt = NonNullable<CellAnswer["doubt"]>;

const SAFE = 3;

/** How doubt was counted; null where none of it was, as on imported ground. */
export function doubtOf(doubt: Doubt, kind: number): string | null {
  const nameOf = (value: number) =>
    TRAVERSABILITY.find((s) => s.value === value)?.name ?? "unknown";
  if (doubt.sigma_m == null)
    return doubt.class_as_seen === SAFE ? "Looks safe, but nobody saw this very place." : null;
  const allowed = doubt.sigmas * doubt.sigma_m;
  if (allowed === 0) return null;
  const counted = `±${(100 * allowed).toFixed(1)} cm of doubt`;
  if (doubt.class_as_seen === kind) return `With ${counted} counted`;
  const may = `its step may be ${metres(doubt.step_m)}, its slope ${degrees(doubt.slope_rad)}`;
  return `Looks ${nameOf(doubt.class_as_seen)}; with ${counted} ${may}.`;
}
