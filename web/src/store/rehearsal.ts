// What is left if a leg fails or a foot settles now: asked for once, then again when the stance has changed
// and is still.

import { create } from "zustand";

import { sentenceOf } from "../api/client";
import type { JobReport, PostureAnswer } from "../api/types";
import { askShown, lookAt } from "./posture";
import { useConsole } from "./console";
import { shownBasis } from "./reach";

export interface RehearsalState {
  /** Being asked for; the job only of the live rover. */
  asking: { job: JobReport | null } | null;
  rehearsal: NonNullable<PostureAnswer["rehearsal"]> | null;
  /** Stance and map that it is for. */
  basis: string | null;
  failure: string | null;
}

const NOTHING: RehearsalState = { asking: null, rehearsal: null, basis: null, failure: null };

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
    if (current()) set({ asking: null, rehearsal: answer?.rehearsal ?? null, basis });
  } catch (error) {
    if (current()) set({ asking: null, rehearsal: null, basis, failure: sentenceOf(error) });
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
