// The posture adviser: what to change before a leg is lifted. Asked of the rover that is shown; what it
// offers for the live one becomes a plan.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type {
  JobReport,
  PostureAnswer,
  PostureProposal,
  PostureRequest,
  StabilityPreference,
} from "../api/types";
import { Latest } from "../lib/latest";
import { offeredBy, type PostureWish, postureRequest, USUAL_WISH } from "../lib/posture";
import { followJob, useConsole } from "./console";
import { takePlan } from "./plan";
import { usePlanOptions } from "./planOptions";
import { shownBasis, shownScene } from "./reach";
import { useSelection } from "./selection";
import { shown } from "./streamState";

export interface PostureState {
  /** The panel is open. */
  open: boolean;
  wish: PostureWish;
  /** Being asked for; the job only of the live rover. */
  asking: { leg: string; job: JobReport | null } | null;
  answer: PostureAnswer | null;
  /** Stance and map that the answer is for. */
  basis: string | null;
  failure: string | null;
  /** The proposal that is being taken up. */
  taking: number | null;
  /** Margins without the chosen leg as the rover stands, and whether the rule holds then. */
  without: { leg: string; stability: StabilityPreference; answer: PostureAnswer } | null;
}

const NOTHING = { asking: null, answer: null, basis: null, failure: null, taking: null };

export const usePosture = create<PostureState>(() => ({
  open: false,
  wish: USUAL_WISH,
  ...NOTHING,
  without: null,
}));

/** A posture that is looked at, drawn as a ghost. */
export const useGhost = create<{ leg: string; end: PostureProposal["end"] | null }>(() => ({
  leg: "",
  end: null,
}));

export function lookAt(leg: string, end: PostureProposal["end"] | null): void {
  if (useGhost.getState().end !== end) useGhost.setState({ leg, end });
}

const set = usePosture.setState;
/** The adviser searches for a while: longer than other requests may (s). */
const DEADLINE_S = 180;

let asked = 0;
let flight: AbortController | null = null;

/** An answer about the rover that is shown: by a job for the live one, else at once. */
export async function askShown(
  request: PostureRequest,
  signal: AbortSignal,
  onJob: (job: JobReport) => void,
): Promise<PostureAnswer | null> {
  const scene = shownScene();
  const whole = { deadline_s: DEADLINE_S, ...request };
  if (scene) return api.postureAtOnce({ ...whole, scene }, signal);
  const accepted = await api.posture(whole);
  const cancel = () => void api.cancelJob(accepted.id).catch(() => {});
  if (signal.aborted) cancel();
  else signal.addEventListener("abort", cancel, { once: true });
  const job = await followJob(accepted, (j) => !signal.aborted && onJob(j));
  signal.removeEventListener("abort", cancel);
  if (job.state === "cancelled") return null;
  if (job.state !== "done" || job.result == null) throw new Error(job.error?.message ?? job.doing);
  return api.postureResult(job.result);
}

export async function askAdviser(leg: string): Promise<void> {
  const mine = ++asked;
  const current = () => mine === asked;
  flight?.abort();
  flight = new AbortController();
  lookAt(leg, null);
  const basis = shownBasis();
  set({ ...NOTHING, asking: { leg, job: null } });
  try {
    const request = postureRequest(leg, usePosture.getState().wish, usePlanOptions.getState());
    const answer = await askShown(
      request,
      flight.signal,
      (job) => current() && set({ asking: { leg, job } }),
    );
    if (current()) set({ asking: null, answer, basis });
  } catch (error) {
    if (current()) set({ asking: null, failure: sentenceOf(error) });
  }
}

export function dropAdvice(): void {
  asked += 1;
  flight?.abort();
  flight = null;
  lookAt("", null);
  const { answer, asking, failure } = usePosture.getState();
  if (answer || asking || failure !== null) set(NOTHING);
}

/** Makes what was offered the plan that is looked at. */
export async function takeUp(proposal: number): Promise<void> {
  const { answer, basis } = usePosture.getState();
  if (!answer?.id) return;
  set({ taking: proposal, failure: null });
  try {
    const plan = await api.planPosture(answer.id, { proposal });
    if (usePosture.getState().answer !== answer) return;
    lookAt("", null);
    takePlan(plan, basis);
    // What was taken up is looked at next: it has the room.
    set({ open: false });
  } catch (error) {
    set({ failure: sentenceOf(error) });
  } finally {
    set({ taking: null });
  }
}

export const offered = (answer: PostureAnswer | null): PostureProposal[] =>
  answer?.advice ? offeredBy(answer.advice) : [];

/** An answer is about one leg: another choice ends it. */
useSelection.subscribe((now, before) => {
  if (now.leg !== before.leg) dropAdvice();
});

/** ... and about one rover: live, or of a replay. */
useConsole.subscribe((now, before) => {
  if (now.stream.replayState?.id !== before.stream.replayState?.id) dropAdvice();
});

interface Question {
  leg: string;
  basis: string;
  stability: StabilityPreference;
}

const latest = new Latest<Question, PostureAnswer>({
  // Without work the answer is what there is: the margins, and whether the rule holds.
  ask: ({ leg, stability }, signal) => {
    const wish = { ...USUAL_WISH, fold: false, replace: false };
    const { advice } = postureRequest(leg, wish, { stability, drive_hold: false, seed: 1 });
    const scene = shownScene();
    return api.postureAtOnce({ advice, budget: 0, ...(scene && { scene }) }, signal);
  },
  answered: ({ leg, stability }, answer) => set({ without: { leg, stability, answer } }),
  failed: () => set({ without: null }),
  late: () => {},
  interval_ms: 500,
  late_ms: 5000,
  pause_ms: 3000,
});

let wanted: Question | null = null;

function update(): void {
  const state = useConsole.getState();
  const { leg } = useSelection.getState();
  const basis = shownBasis(state);
  const idle = shown(state.stream).rover?.message.mode !== "executing";
  if (leg === null || basis === null) {
    wanted = null;
    latest.stop();
    if (usePosture.getState().without) set({ without: null });
    return;
  }
  if (state.connection !== "open" || !idle) return;
  const { stability } = usePlanOptions.getState();
  if (wanted?.leg === leg && wanted.basis === basis && wanted.stability === stability) return;
  wanted = { leg, basis, stability };
  latest.want(wanted);
}

/** Keeps the margins without the chosen leg up to date until the returned function is called. */
export function startPosture(): () => void {
  const stops = [useConsole, useSelection, usePlanOptions].map((store) =>
    (store.subscribe as (listener: () => void) => () => void)(update),
  );
  update();
  return () => {
    for (const stop of stops) stop();
    wanted = null;
    latest.stop();
  };
}
