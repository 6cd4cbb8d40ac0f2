// The plan being made or looked at, and where its preview stands.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { CommandRecord, JobReport, PlanAnswer, Vec3 } from "../api/types";
import { endOfCommand, isBegun, isOver, planProgress } from "../lib/planProgress";
import { followJob, useConsole } from "./console";
import { liveBasis } from "./reach";
import { planRequest } from "./planOptions";
import { useSelection } from "./selection";

export interface PlanState {
  job: JobReport | null;
  plan: PlanAnswer | null;
  /** Stance and map when the plan came. */
  basis: string | null;
  failure: string | null;
  /** Where the preview is (s after the step's start). */
  at_s: number;
  playing: boolean;
}

export const usePlan = create<PlanState>(() => ({
  job: null,
  plan: null,
  basis: null,
  failure: null,
  at_s: 0,
  playing: false,
}));

const set = usePlan.setState;
let asked = 0;

export async function makePlan(leg: string, target_m: Vec3): Promise<void> {
  const mine = ++asked;
  const current = () => mine === asked;
  stopPlaying();
  set({ job: null, plan: null, failure: null, at_s: 0 });
  try {
    const accepted = await api.plan(planRequest(leg, target_m));
    const job = await followJob(accepted, (j) => current() && set({ job: j }));
    if (!current() || job.state === "cancelled") return;
    if (job.state !== "done" || job.result == null) {
      set({ job: null, failure: job.error?.message ?? job.doing });
      return;
    }
    const plan = await api.planResult(job.result);
    if (current()) set({ job: null, plan, basis: liveBasis() });
  } catch (error) {
    if (current()) set({ job: null, failure: sentenceOf(error) });
  }
}

/** Looks at a plan that came about otherwise, as from the posture adviser. */
export function takePlan(plan: PlanAnswer, basis: string | null): void {
  dropPlan();
  set({ plan, basis });
}

export function cancelPlanning(): void {
  const { job } = usePlan.getState();
  asked += 1;
  set({ job: null });
  // The job ends by itself if this does not arrive.
  if (job) api.cancelJob(job.id).catch(() => {});
}

export function dropPlan(): void {
  asked += 1;
  stopPlaying();
  set({ job: null, plan: null, failure: null, at_s: 0 });
}

/** A new leg or place ends a plan of which nothing is under way. */
useSelection.subscribe((now, before) => {
  const { plan } = usePlan.getState();
  if (!plan || (now.leg === before.leg && now.pick === before.pick)) return;
  const commands = useConsole.getState().stream.live.commands;
  const progress = planProgress(plan, commands);
  if (!isBegun(progress) || isOver(progress)) dropPlan();
});

/** When a command is done or undone the preview goes there: beside what was reached. */
useConsole.subscribe((now, before) => {
  const { plan } = usePlan.getState();
  const commands = now.stream.live.commands;
  if (!plan || plan.commands.length === 0 || commands === before.stream.live.commands) return;
  const done = (of: CommandRecord[]) => planProgress(plan, of).done;
  const now_done = done(commands);
  if (now_done === done(before.stream.live.commands)) return;
  stopPlaying();
  set({ at_s: endOfCommand(plan, now_done - 1) });
});

export function planDuration(plan: PlanAnswer): number {
  return plan.waypoints.at(-1)?.time_s ?? 0;
}

export function scrubTo(at_s: number): void {
  const { plan } = usePlan.getState();
  if (plan) set({ at_s: Math.min(Math.max(0, at_s), planDuration(plan)) });
}

/** A step takes minutes on the rover; the preview takes about this long (s). */
const PREVIEW_S = 6;
let frame = 0;

export function stopPlaying(): void {
  cancelAnimationFrame(frame);
  if (usePlan.getState().playing) set({ playing: false });
}

export function togglePlaying(): void {
  const { plan, playing, at_s } = usePlan.getState();
  if (playing) return stopPlaying();
  if (!plan) return;
  const length = planDuration(plan);
  const speed = Math.max(1, length / PREVIEW_S);
  if (at_s >= length - 1e-6) set({ at_s: 0 });
  set({ playing: true });
  let last = performance.now();
  const tick = (now: number) => {
    const state = usePlan.getState();
    if (!state.playing || state.plan !== plan) return;
    if (now - last >= 60) {
      const next = state.at_s + ((now - last) / 1000) * speed;
      last = now;
      if (next >= length) return set({ at_s: length, playing: false });
      set({ at_s: next });
    }
    frame = requestAnimationFrame(tick);
  };
  frame = requestAnimationFrame(tick);
}
