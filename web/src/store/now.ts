// One ticker for everything on screen that depends on the time.

import { useSyncExternalStore } from "react";

import { localNow } from "../api/stream";
import { parseTime } from "../lib/time";
import { serverNow } from "./clock";
import { useConsole } from "./console";

const TICK_MS = 200;
const listeners = new Set<() => void>();
let timer = 0;
let tick = 0;

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  if (timer === 0) {
    timer = window.setInterval(() => {
      tick = Math.floor(localNow() / TICK_MS);
      for (const each of listeners) each();
    }, TICK_MS);
  }
  return () => {
    listeners.delete(listener);
    if (listeners.size === 0) {
      clearInterval(timer);
      timer = 0;
    }
  };
}

/** Server time (ms), five times a second. */
export function useServerNow(): number {
  useSyncExternalStore(subscribe, () => tick);
  return serverNow();
}

/** The time that the shown data is to be judged by: server time, or where the replay is. */
export function shownNow(): number {
  const { stream, replayHeard_ms } = useConsole.getState();
  const replay = stream.replayState;
  if (!replay) return serverNow();
  const at = parseTime(replay.at);
  if (replay.paused || replay.ended) return at;
  const run = (localNow() - replayHeard_ms) * replay.rate;
  return Math.min(at + Math.max(0, run), parseTime(replay.end));
}

export function useShownNow(): number {
  useSyncExternalStore(subscribe, () => tick);
  return shownNow();
}
