// Why a leg cannot stand at a cell, in words: the answer of the reachability grid, read out.

import type { CellExplanation, CellMend } from "../api/types";
import { type ClassStyle, PLANNED, REACHABILITY, type Reason, REASONS } from "../scene/palette";
import { capital, degrees, metres, percent, readable, signless } from "./format";

const REACHABLE = 4;
const PLANNABLE = 6;
const NOT_PLANNABLE = 7;

/** Can the leg stand there, as far as is known? */
export const canStand = (kind: number): boolean => kind === REACHABLE || kind === PLANNABLE;

/** Can it stand there where yet no step to it was found? */
export const isOutOfPlan = (kind: number): boolean => kind === NOT_PLANNABLE;

/** The style of a class, for picture and legend alike. */
export const reachStyle = (kind: number): ClassStyle | undefined =>
  [...REACHABILITY, ...PLANNED].find((s) => s.value === kind);

/** A cell of the reachability grid. */
export interface ReachCell {
  class: number;
  reason: number;
  /** In the unit of the reason. */
  missing: number;
  margin_m: number;
}

export interface WhyNot {
  /** The class by its name in the legend. */
  verdict: string;
  /** Which check fails; null where none does, or where nobody told. */
  reason: string | null;
  /** What it lacks, with its unit. */
  missing: string | null;
  /** Margin while the leg is up. */
  margin: string | null;
}

function amount(missing: number, unit: Reason["unit"]): string {
  if (unit === "rad") return degrees(missing);
  if (unit === "share") return percent(missing);
  return unit === "goodness" ? `${signless(missing, 2)} of goodness` : metres(missing);
}

export function whyNot(cell: ReachCell): WhyNot {
  const verdict = reachStyle(cell.class)?.name ?? "unknown";
  const margin = Number.isFinite(cell.margin_m) ? metres(cell.margin_m) : null;
  if (canStand(cell.class)) return { verdict, reason: null, missing: null, margin };
  const known = REASONS[cell.reason];
  const reason = known?.text ?? (cell.reason === 0 ? null : `reason ${cell.reason}`);
  const short = Number.isFinite(cell.missing) && cell.missing > 0;
  return {
    verdict,
    reason,
    missing: short ? amount(cell.missing, known?.unit ?? "m") : null,
    margin,
  };
}

/** One change that was tried and helps, as a clause. */
function mend({ shift_m, place_m }: CellMend, from: { x: number; y: number }): string | null {
  if (shift_m) {
    const [x, y, z] = shift_m as [number, number, number];
    if (Math.abs(z) > 1e-6) return `stand ${metres(Math.abs(z))} ${z > 0 ? "taller" : "lower"}`;
    return `shift the body by ${signless(x, 2)}, ${signless(y, 2)} m`;
  }
  if (!place_m) return null;
  const away = Math.hypot(place_m[0] - from.x, place_m[1] - from.y);
  return `take the place ${metres(away)} beside, at ${place_m.map((v) => signless(v, 2)).join(", ")}`;
}

export interface Help {
  /** What stands in the way by name, where more is known than the reason says. */
  what: string | null;
  /** What would help. */
  mends: string;
}

/** What the server tried, without what the grid has said already. */
export function whatHelps(
  { obstruction, mends }: Pick<CellExplanation, "obstruction" | "mends">,
  [x, y]: readonly number[],
): Help {
  const clauses = mends.map((m) => mend(m, { x: x!, y: y! })).filter((m) => m !== null);
  return {
    what: obstruction ? `${capital(readable(obstruction))}.` : null,
    mends:
      clauses.length > 0 ? `${capital(clauses.join(", or "))}.` : "Nothing that was tried helps.",
  };
}
