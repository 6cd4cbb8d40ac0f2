// The plan that follows the pointer: asked for while a leg is chosen and the pointer is on the ground,
// never kept by the server, and gone when the pointer is.

import { create } from "zustand";

import { api, ApiError, sentenceOf } from "../api/client";
import type { CommandRecord, PlanAnalysis, PlanAnswer, Vec3 } from "../api/types";
import { Latest } from "../lib/latest";
import { isOver, planProgress } from "../lib/planProgress";
import { useConsole } from "./console";
import { usePlan } from "./plan";
import { planRequest } from "./planOptions";
import { liveBasis } from "./reach";
import { useSelection } from "./selection";
import { useView } from "./view";

export interface FollowState {
  /** The pointer is being followed. */
  active: boolean;
  /** The last answer, and the place that it is for. */
  shown: { target_m: Vec3; answer: PlanAnalysis } | null;
  /** A newer one has been waited for so long that this one is old. */
  late: boolean;
  failure: string | null;
}

const NOTHING: FollowState = { active: false, shown: null, late: false, failure: null };

export const useFollow = create<FollowState>(() => NOTHING);

/** What is shown must come while the pointer moves: a plan to be sent is searched for longer. */
export const FOLLOW_DEADLINE_S = 0.25;
const SMOOTHING = { max_rounds: 2, max_edges: 100 };
const BUSY = 429;

interface Question {
  leg: string;
  target_m: Vec3;
  /** Stance and map. */
  basis: string;
}

const set = useFollow.setState;
let asked: Question | null = null;

const latest = new Latest<Question, PlanAnalysis>({
  ask: ({ leg, target_m }, signal) =>
    api.planAtOnce(
      { ...planRequest(leg, target_m), deadline_s: FOLLOW_DEADLINE_S, smoothing: SMOOTHING },
      signal,
    ),
  answered: ({ target_m }, answer) => set({ shown: { target_m, answer }, failure: null }),
  failed: (question, error) => {
    if (error instanceof ApiError && error.status === BUSY) latest.want(asked ?? question);
    else set({ shown: null, failure: sentenceOf(error) });
  },
  late: (late) => set({ late }),
  interval_ms: 50,
  late_ms: 200,
  pause_ms: 400,
});

/** A plan that is looked at is not to be drawn over, until it is done or backed out. */
export function keepsFollowing(plan: PlanAnswer | null, commands: CommandRecord[]): boolean {
  if (plan?.outcome !== "found") return true;
  return isOver(planProgress(plan, commands));
}

/** What to ask for now; null where nothing is. */
function wanted(): Question | null {
  const { leg, hover } = useSelection.getState();
  if (leg === null || hover === null || !useView.getState().follow) return null;
  const { stream, connection } = useConsole.getState();
  if (stream.replayState || connection !== "open") return null;
  if (stream.live.rover?.message.mode === "executing") return null;
  const { job, plan } = usePlan.getState();
  if (job || !keepsFollowing(plan, stream.live.commands)) return null;
  const basis = liveBasis();
  return basis === null ? null : { leg, target_m: hover, basis };
}

function update(): void {
  const next = wanted();
  if (asked && asked.leg !== next?.leg) {
    latest.stop();
    asked = null;
    set(NOTHING);
  }
  if (!next || (asked?.target_m === next.target_m && asked.basis === next.basis)) return;
  if (!asked) set({ active: true });
  asked = next;
  latest.want(next);
}

/** Follows the pointer until the returned function is called. */
export function startFollowing(): () => void {
  const stops = [
    useSelection.subscribe(update),
    useView.subscribe(update),
    usePlan.subscribe(update),
    useConsole.subscribe(update),
  ];
  return () => {
    for (const stop of stops) stop();
    latest.stop();
    asked = null;
    set(NOTHING);
  };
}
