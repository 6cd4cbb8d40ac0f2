// The words of a plan: its phases, its planners, and what is in the way of one that was not found.

import type { PlanAnswer, PlanCommand, PlanStatistics } from "../api/types";
import { capital, degrees, legLabel, metres, percent, readable, words } from "./format";

type Phase = PlanCommand["phase"];

const PHASES: Record<Phase, string> = {
  shift: "body shift",
  lift: "lift",
  transit: "transit",
  drop: "drop",
  preload: "preload",
};

export const phaseName = (phase: Phase): string => PHASES[phase] ?? words(phase);

const PLANNERS: Record<NonNullable<PlanStatistics["planner"]>, string> = {
  joint_line: "straight in joint space",
  astar: "A*",
  sbl: "SBL",
  rrt_connect: "RRT-Connect",
  line: "straight line",
};

/** Who found the path; null where nobody did. */
export function plannerName(statistics: PlanStatistics): string | null {
  const { planner } = statistics;
  return planner == null ? null : (PLANNERS[planner] ?? words(planner));
}

/** Time that an answer took on the server (ms). */
export function tookMs({ search_ms, smoothing_ms, check_ms }: PlanStatistics): number {
  return search_ms + smoothing_ms + check_ms;
}

export function milliseconds(ms: number): string {
  return `${ms.toFixed(ms < 9.95 ? 1 : 0)} ms`;
}

/** Each constraint with the figure that is missing, and without. */
const CONSTRAINTS: Record<string, [with_figure: (figure: string) => string, plain: string]> = {
  reach: [(f) => `${f} out of reach`, "out of reach"],
  joint_limits: [(f) => `a joint ${f} beyond its limit`, "a joint beyond its limit"],
  ground: [(f) => `${f} too uneven under the wheel`, "no ground for the wheel"],
  unknown_ground: [() => "ground not seen", "ground not seen"],
  clearance: [(f) => `${f} too little clearance`, "something in the way"],
  stability: [(f) => `${f} too little margin`, "too little stability margin"],
  torque: [(f) => `a joint ${f} over its torque`, "a joint overloaded"],
  search: [() => "no way found within the budget", "no way found within the budget"],
};

const OUTCOMES: Record<string, string> = {
  no_path: "no way found",
  unreachable: "out of reach",
  no_lift: "the leg cannot be lifted there",
  unstable: "too little stability margin",
  colliding: "something in the way",
  unknown_ground: "ground not seen",
  refused: "refused by the final check",
  deadline: "no answer in the time allowed",
};

function figure(missing: number, unit: string): string {
  if (unit === "rad") return degrees(missing);
  if (unit === "share") return percent(missing);
  // Clearances are short by millimetres.
  return missing < 0.0995 ? `${(missing * 100).toFixed(1)} cm` : metres(missing);
}

/** How much is missing, with its unit, or null where no figure says it. */
export function missingFigure({ constraint }: Pick<PlanAnswer, "constraint">): string | null {
  const missing = constraint?.missing;
  if (missing == null || !Number.isFinite(missing) || missing <= 0) return null;
  return figure(missing, constraint!.unit);
}

type NotFound = Pick<PlanAnswer, "outcome" | "constraint">;

/** What is in the way, in few words: `0.12 m out of reach`. */
export function inTheWay(plan: NotFound): string {
  const known = plan.constraint && CONSTRAINTS[plan.constraint.name];
  if (known) {
    const amount = missingFigure(plan);
    return amount === null ? known[1] : known[0](amount);
  }
  if (plan.constraint) return words(plan.constraint.name);
  return OUTCOMES[plan.outcome] ?? words(plan.outcome);
}

/** The same as a title with the leg before it: `Leg 2: 0.12 m out of reach`. */
export function inTheWayOf(plan: NotFound & Pick<PlanAnswer, "leg">): string {
  return `${capital(legLabel(plan.leg))}: ${inTheWay(plan)}`;
}

/** The server's own sentence about it, or null. */
export function whySentence(plan: Pick<PlanAnswer, "constraint" | "reason">): string | null {
  const said = plan.constraint?.detail || plan.reason;
  return said ? capital(readable(said)) : null;
}

/** The parts of the retreat that undo the first `done` commands, in the order to be driven. */
export function wayBack(
  { retreat, commands }: Pick<PlanAnswer, "retreat" | "commands">,
  done: number,
): PlanCommand[] {
  // The last part comes first: what undoes commands that were not executed is left out.
  return retreat.slice(Math.max(0, commands.length - done));
}

export interface PhaseSpan {
  phase: Phase;
  from_s: number;
  to_s: number;
}

/** When each part of the step begins and ends. */
export function phaseSpans(waypoints: { phase: Phase; time_s: number }[]): PhaseSpan[] {
  const spans: PhaseSpan[] = [];
  let from_s = waypoints[0]?.time_s ?? 0;
  for (const { phase, time_s } of waypoints.slice(1)) {
    const last = spans.at(-1);
    if (last?.phase === phase) last.to_s = time_s;
    else if (time_s > from_s) spans.push({ phase, from_s, to_s: time_s });
    from_s = time_s;
  }
  return spans;
}
