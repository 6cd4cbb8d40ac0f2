// E-stop: one action to stop, two to release.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import { parseOptional } from "../lib/time";
import { useConsole } from "./console";
import { serverNow } from "./clock";

interface EstopUi {
  /** When the last E-stop or release reaches the rover at the earliest (ms). */
  takesEffect_ms: number | null;
  /** First step of a release was done: its token, and until when it holds (ms). */
  token: string | null;
  tokenUntil_ms: number;
  asking: boolean;
  failure: string | null;
}

export const useEstop = create<EstopUi>(() => ({
  takesEffect_ms: null,
  token: null,
  tokenUntil_ms: 0,
  asking: false,
  failure: null,
}));

const set = useEstop.setState;

/** Asks for the stop whatever the console believes about the connection. */
export async function stopRover(): Promise<void> {
  set({ asking: true, failure: null, token: null });
  try {
    const answer = await api.estop();
    set({ takesEffect_ms: parseOptional(answer.takes_effect) });
  } catch (error) {
    set({ failure: `The E-stop was not sent. ${sentenceOf(error)}` });
  } finally {
    set({ asking: false });
  }
}

export async function beginRelease(): Promise<void> {
  await release(undefined);
}

export async function confirmRelease(): Promise<void> {
  const { token } = useEstop.getState();
  if (token !== null) await release(token);
}

async function release(token: string | undefined): Promise<void> {
  set({ asking: true, failure: null });
  try {
    const answer = await api.releaseEstop(token);
    set({
      token: answer.token ?? null,
      tokenUntil_ms: serverNow() + 10_000,
      takesEffect_ms: token === undefined ? null : parseOptional(answer.takes_effect),
    });
  } catch (error) {
    set({ failure: sentenceOf(error), token: null });
  } finally {
    set({ asking: false });
  }
}

/** What the ground knows; while replaying still that of the live rover. */
export function useEstopState() {
  return useConsole((s) => s.stream.live.link?.message.estop ?? "clear");
}
