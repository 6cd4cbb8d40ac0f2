// Why a leg cannot stand at a cell, in words: the answer of the reachability grid, read out.

import { REACHABILITY, type Reason, REASONS } from "../scene/palette";
import { degrees, metres, percent, signless } from "./format";

const REACHABLE = 4;

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
  const verdict = REACHABILITY.find((s) => s.value === cell.class)?.name ?? "unknown";
  const margin = Number.isFinite(cell.margin_m) ? metres(cell.margin_m) : null;
  if (cell.class === REACHABLE) return { verdict, reason: null, missing: null, margin };
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
