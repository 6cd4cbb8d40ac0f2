// What is left if a leg fails or a foot settles now: asked for once, then again when the stance has changed
// and is still.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { JobReport, PostureAccident, PostureAnswer } from "../api/types";
import { askShown, lookAt } from "./posture";
import { useConsole } from "./console";
import { takePlan } from "./plan";
import { shownBasis } from "./reach";
import { chooseLeg } from "./selection";
import { useView } from "./view";

export interface RehearsalState {
  /** Being asked for; the job only of the live rover. */
  asking: { job: JobReport | null } | null;
  rehearsal: NonNullable<PostureAnswer["rehearsal"]> | null;
  /** Stance and map that it is for. */
  basis: string | null;
  failure: string | null;
  /** Name of the answer, where it is about the live rover: its ways back can be taken up. */
  id: string | null;
  /** The accident whose way back is being taken up. */
  taking: PostureAccident | null;
}

const NOTHING: RehearsalState = {
  asking: null,
  rehearsal: null,
  basis: null,
  failure: null,
  id: null,
  taking: null,
};

export const useRehearsal = create<RehearsalState>(() => NOTHING);

const set = useRehearsal.setState;
let asked = 0;
let flight: AbortController | null = null;

export async function askRehearsal(): Promise<void> {
  const mine = ++asked;
  const current = () => mine === asked;
  flight?.abort();
  flight = new AbortController();
  const basis = shownBasis();
  // What was told before stays on screen, marked as old, until the new answer is there.
  set({ asking: { job: null }, failure: null });
  try {
    const answer = await askShown(
      { rehearsal: {} },
      flight.signal,
      (job) => current() && set({ asking: { job } }),
    );
    if (current()) {
      set({ asking: null, rehearsal: answer?.rehearsal ?? null, id: answer?.id ?? null, basis });
    }
  } catch (error) {
    if (current()) set({ asking: null, rehearsal: null, basis, failure: sentenceOf(error) });
  }
}

/** Makes the way back from an accident the plan that is looked at. */
export async function takeWayBack(accident: PostureAccident): Promise<void> {
  const { id, basis } = useRehearsal.getState();
  if (id === null) return;
  set({ taking: accident, failure: null });
  try {
    const plan = await api.planPosture(id, { way_back: accident });
    if (useRehearsal.getState().id !== id) return;
    lookAt("", null);
    // A choice of another leg would drop the plan: the leg first.
    chooseLeg(accident.leg);
    takePlan(plan, basis);
    // What was taken up is looked at next.
    useView.setState({ tab: "step" });
  } catch (error) {
    set({ failure: sentenceOf(error) });
  } finally {
    set({ taking: null });
  }
}

/** Ends the asking; what is known of the stance before goes with it. */
export function cancelRehearsal(): void {
  asked += 1;
  flight?.abort();
  flight = null;
  lookAt("", null);
  set({ ...NOTHING });
}

/** It is about one rover: live, or of a replay. */
useConsole.subscribe((now, before) => {
  if (now.stream.replayState?.id !== before.stream.replayState?.id) cancelRehearsal();
});
