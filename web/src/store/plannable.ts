// Planning to every cell that the chosen leg can reach: a job of the server, whose cells are shown as they
// come. Of the live rover only.

import { create } from "zustand";

import { api, ApiError, sentenceOf } from "../api/client";
import { type ReachGrid, readReachGrid } from "../api/tiles";
import type { JobReport, StabilityPreference } from "../api/types";
import { followJob, useConsole } from "./console";
import { liveBasis, notePlanned, reachBasis, useReach } from "./reach";

export interface PlannableState {
  /** The leg that is planned for, and for which stance, map and preference. */
  of: { leg: string; basis: string } | null;
  job: JobReport | null;
  failure: string | null;
}

const NOTHING: PlannableState = { of: null, job: null, failure: null };

export const usePlannable = create<PlannableState>(() => NOTHING);

const set = usePlannable.setState;
/** Between two looks at what the server keeps up to date (ms). */
const LOOK_MS = 500;
/** Longest wait for the server's own cells of a leg (ms). */
const WAIT_MS = 60_000;
const CHANGED = "The stance has changed: ask again.";
let asked = 0;

const pause = (ms: number) => new Promise((resolve) => setTimeout(resolve, ms));

/** Waits until the server itself knows the cells of the leg, for this preference. */
async function known(leg: string, stability: StabilityPreference, current: () => boolean) {
  let summary = await api.liveReach();
  // A change of preference is taken up a moment later: until then the cells are those of the one before.
  const outdated = summary.stability === stability ? null : summary.basis;
  if (outdated !== null) await api.preferReach(stability);
  const before = Date.now();
  while (summary.basis === outdated || !summary.legs[leg]) {
    if (summary.failure) throw new Error(summary.failure);
    if (Date.now() - before > WAIT_MS) throw new Error("The server has not come to this leg yet.");
    await pause(LOOK_MS);
    if (!current()) return;
    summary = await api.liveReach();
  }
}

export async function planToCells(leg: string, stability: StabilityPreference): Promise<void> {
  const basis = reachBasis(liveBasis(), stability);
  if (basis === null) return;
  const mine = ++asked;
  const current = () => mine === asked;
  set({ of: { leg, basis }, job: null, failure: null });
  let shown_ms = 0;
  const show = async () => {
    shown_ms = Date.now();
    const grid = readReachGrid(await api.liveCells(leg));
    const reach = useReach.getState();
    if (current() && reach.leg === leg && reach.basis === basis) useReach.setState({ grid });
  };
  try {
    await known(leg, stability, current);
    if (!current()) return;
    const accepted = await api.planToCells(leg);
    notePlanned(leg, basis);
    const job = await followJob(accepted, (report) => {
      if (!current()) {
        // Taken back while the answer was on its way.
        if (report === accepted) void api.cancelJob(report.id).catch(() => {});
        return;
      }
      set({ job: report });
      // What does not come now comes with the next word.
      if (Date.now() - shown_ms > LOOK_MS) show().catch(() => {});
    });
    if (!current()) return;
    if (job.state === "failed") throw new Error(job.error?.message ?? job.doing);
    if (job.state === "cancelled") throw new Error(CHANGED);
    await show();
    set(NOTHING);
  } catch (error) {
    if (!current()) return;
    // The stance has changed meanwhile: the cells are another matter then.
    const moved = error instanceof ApiError && error.info.code === "not_ready";
    set({ ...NOTHING, failure: moved ? CHANGED : sentenceOf(error) });
  }
}

export function cancelPlannable(): void {
  const { of, job } = usePlannable.getState();
  asked += 1;
  set(NOTHING);
  // The job ends by itself with the next change of stance, should this not arrive.
  if (of && job) showLast(of, job.id).catch(() => {});
}

/** Cancels a job, and shows what it came to before it heard of that. */
async function showLast(of: { leg: string; basis: string }, job: string): Promise<void> {
  await api.cancelJob(job);
  await pause(LOOK_MS);
  const grid = readReachGrid(await api.liveCells(of.leg));
  const reach = useReach.getState();
  const same = reach.leg === of.leg && reach.basis === of.basis;
  if (same && usePlannable.getState().of === null) useReach.setState({ grid });
}

/** Another stance, map or preference ends the work; the server ends its part by itself. */
useConsole.subscribe((now, before) => {
  const { of } = usePlannable.getState();
  if (!of || now.stream.live.rover === before.stream.live.rover) return;
  const stability = of.basis.split("|")[0] as StabilityPreference;
  if (reachBasis(liveBasis(now), stability) !== of.basis) cancelPlannable();
});

export interface PlannedCount {
  /** Cells that a step was found to, none was found to, and that nobody has planned to. */
  found: number;
  none: number;
  open: number;
  /** Squares that the server would still plan to: with reachable cells, of which none was planned to. */
  squares: number;
}

/** Side of the squares of which the server plans to one cell, for a robot of scale 1 (m). */
const SQUARE_M = 0.1;

/** How many of the cells shown have been planned to, with what came of it, and what is left. */
export function plannedCount({ classes, header }: ReachGrid, scale: number): PlannedCount {
  const side = Math.max(1, Math.round((SQUARE_M * scale) / header.resolution_m));
  const nx = header.size[0];
  const across = Math.ceil(nx / side);
  const count = { found: 0, none: 0, open: 0, squares: 0 };
  const [open, done] = [new Set<number>(), new Set<number>()];
  for (const [cell, kind] of classes.entries()) {
    if (kind !== 4 && kind !== 6 && kind !== 7) continue;
    const square =
      Math.floor(Math.floor(cell / nx) / side) * across + Math.floor((cell % nx) / side);
    if (kind === 4) {
      count.open += 1;
      open.add(square);
    } else {
      count[kind === 6 ? "found" : "none"] += 1;
      done.add(square);
    }
  }
  count.squares = [...open].filter((square) => !done.has(square)).length;
  return count;
}
