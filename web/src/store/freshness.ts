// How old the shown telemetry is, and whether it counts as old.

import { useConsole, type ConsoleState } from "./console";
import { useShownNow } from "./now";
import { shown } from "./streamState";

/** Telemetry comes ten times a second; without any for this long it is old (s). */
const SILENCE_S = 1;

export interface Freshness {
  /** Since the frame was true on board (s); null without any frame. */
  age_s: number | null;
  stale: boolean;
}

export function freshnessOf(state: ConsoleState, now_ms: number): Freshness {
  const channels = shown(state.stream);
  const rover = channels.rover;
  if (!rover) return { age_s: null, stale: true };
  const age_s = Math.max(0, (now_ms - rover.onboard_ms) / 1000);
  const delays = channels.link?.message.config;
  const round_trip_s = delays ? delays.up_delay_s + delays.down_delay_s : 0;
  const silent = (now_ms - rover.received_ms) / 1000 > SILENCE_S;
  const lost = state.connection !== "open";
  if (state.stream.replayState) return { age_s, stale: lost };
  return { age_s, stale: lost || (silent && age_s > SILENCE_S) || age_s > round_trip_s + 2 };
}

export function useFreshness(): Freshness {
  // Five times a second is often enough; telemetry itself comes faster.
  const now = useShownNow();
  return freshnessOf(useConsole.getState(), now);
}
