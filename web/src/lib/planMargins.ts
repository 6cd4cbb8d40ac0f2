// Margins along a plan: every kind there is, read at any time of it. A server that tells the regular one
// only, as a list of samples, is understood too.

import type { PlanAnalysis } from "../api/types";

export const CURVES = ["regular", "conservative", "friction"] as const;
export type Curve = (typeof CURVES)[number];

/** Samples in the order of time; null where there is none of a kind. */
export interface PlanMargins {
  time_s: number[];
  /** Margins (m). */
  regular: (number | null)[];
  conservative: (number | null)[];
  friction: (number | null)[];
  /** Rise (m) and work (J) that would tip the rover. */
  energy_m: (number | null)[];
  energy_j: (number | null)[];
  /** What decides the regular margin, in the server's words. */
  critical: (string | null)[];
}

type Raw = Record<string, unknown>;

const isNumber = (v: unknown): v is number => typeof v === "number" && Number.isFinite(v);

/** What a plan tells of its margins; null where it tells nothing that can be drawn. */
export function planMargins(plan: Pick<PlanAnalysis, "margins">): PlanMargins | null {
  const told: unknown = plan.margins;
  if (Array.isArray(told)) return ofSamples(told as Raw[]);
  if (typeof told !== "object" || told === null) return null;
  const columns = told as Raw;
  const time_s = Array.isArray(columns.time_s) ? (columns.time_s as unknown[]) : [];
  if (time_s.length < 2 || !time_s.every(isNumber)) return null;
  const numbers = (name: string) => {
    const column = Array.isArray(columns[name]) ? (columns[name] as unknown[]) : [];
    return time_s.map((_, i) => (isNumber(column[i]) ? column[i] : null));
  };
  const critical = Array.isArray(columns.critical) ? (columns.critical as unknown[]) : [];
  return {
    time_s,
    regular: numbers("regular_m"),
    conservative: numbers("conservative_m"),
    friction: numbers("friction_m"),
    energy_m: numbers("energy_m"),
    energy_j: numbers("energy_j"),
    critical: time_s.map((_, i) => {
      const name = critical[i];
      return typeof name === "string" && name !== "" ? name : null;
    }),
  };
}

function ofSamples(samples: Raw[]): PlanMargins | null {
  const usable = samples.filter((s) => isNumber(s.time_s) && isNumber(s.margin_m));
  if (usable.length < 2) return null;
  const none = usable.map(() => null);
  return {
    time_s: usable.map((s) => s.time_s as number),
    regular: usable.map((s) => s.margin_m as number),
    conservative: none,
    friction: none,
    energy_m: none,
    energy_j: none,
    critical: none,
  };
}

/** The samples of one kind without those that are not there, in runs that are to be drawn as one line. */
export function runsOf(margins: PlanMargins, curve: Curve): [time_s: number, margin_m: number][][] {
  const runs: [number, number][][] = [];
  let open = false;
  margins[curve].forEach((m, i) => {
    if (m === null) {
      open = false;
      return;
    }
    if (!open) runs.push([]);
    open = true;
    runs.at(-1)!.push([margins.time_s[i]!, m]);
  });
  return runs;
}

/** The least regular margin and when it is. */
export function leastOf(margins: PlanMargins): { time_s: number; margin_m: number } | null {
  let least: { time_s: number; margin_m: number } | null = null;
  margins.regular.forEach((m, i) => {
    if (m !== null && (least === null || m < least.margin_m)) {
      least = { time_s: margins.time_s[i]!, margin_m: m };
    }
  });
  return least;
}

export interface MarginsAt {
  regular: number | null;
  conservative: number | null;
  friction: number | null;
  energy_m: number | null;
  energy_j: number | null;
  critical: string | null;
}

/** What holds at a time: between two samples along the line, with a gap none. */
export function marginsAt(margins: PlanMargins, t: number): MarginsAt {
  const { time_s } = margins;
  const last = time_s.length - 1;
  const after = time_s.findIndex((time) => time >= t - 1e-9);
  const j = after < 0 ? last : after;
  const i = after <= 0 || after < 0 ? j : j - 1;
  const span = time_s[j]! - time_s[i]!;
  const s = span > 0 ? Math.min(1, Math.max(0, (t - time_s[i]!) / span)) : 1;
  const between = (column: (number | null)[]) => {
    const [a, b] = [column[i] ?? null, column[j] ?? null];
    if (s >= 1 - 1e-9) return b;
    return a === null || b === null ? null : a + s * (b - a);
  };
  return {
    regular: between(margins.regular),
    conservative: between(margins.conservative),
    friction: between(margins.friction),
    energy_m: between(margins.energy_m),
    energy_j: between(margins.energy_j),
    critical: margins.critical[s > 0.5 ? j : i] ?? null,
  };
}
