// Gathers the margins of what is shown, live or replayed; begins anew when the source changes. Where a replay
// begins or jumps, what came before is asked for, so that the strip is as if it had been played.

import { create } from "zustand";

import { api } from "../api/client";
import type { ReplayMargins, StabilityDerived } from "../api/types";
import {
  isJump,
  type MarginBuffer,
  type MarginSample,
  NO_MARGINS,
  withEarlier,
  withSample,
} from "../lib/marginBuffer";
import { regionOf } from "../lib/regions";
import { type ConsoleState, useConsole } from "./console";
import { shown, type Stamped } from "./streamState";

/** What can be drawn: replaced when a span is full, twice a second at most in live. */
export const useMarginHistory = create<{ samples: MarginSample[] }>(() => ({ samples: [] }));

let buffer: MarginBuffer = NO_MARGINS;
let source: string | null = null;
let last: Stamped<StabilityDerived> | null = null;

export function sampleOf({ message, onboard_ms }: Stamped<StabilityDerived>): MarginSample {
  const margin = (key: "regular" | "conservative" | "friction") =>
    regionOf(message, key).polygon?.margin_m ?? NaN;
  return {
    at_ms: onboard_ms,
    regular: margin("regular"),
    conservative: margin("conservative"),
    friction: margin("friction"),
  };
}

const earlierOf = ({ samples }: ReplayMargins): MarginSample[] =>
  samples.map(({ at, regular_m, conservative_m, friction_m }) => ({
    at_ms: Date.parse(at),
    regular: regular_m ?? NaN,
    conservative: conservative_m ?? NaN,
    friction: friction_m ?? NaN,
  }));

/** The replay that is asked, and whether it has jumped since. */
let asking: { id: string; again: boolean } | null = null;

/** One question at a time: a scrub that jumps on and on is answered where it ends. */
async function ask(id: string): Promise<void> {
  if (asking?.id === id) {
    asking.again = true;
    return;
  }
  const mine = { id, again: true };
  asking = mine;
  while (mine.again && asking === mine) {
    mine.again = false;
    // Where it cannot be told, the strip fills as the replay goes.
    const answer = await api.replayMargins(id).catch(() => null);
    if (asking !== mine) return;
    if (!answer || mine.again) continue;
    buffer = withEarlier(buffer, earlierOf(answer));
    useMarginHistory.setState({ samples: buffer.samples });
  }
  if (asking === mine) asking = null;
}

const sourceOf = ({ stream, logId }: ConsoleState) =>
  stream.replayState ? `replay ${stream.replayState.id}` : `live ${logId ?? ""}`;

function gather(state: ConsoleState): void {
  const from = sourceOf(state);
  if (from !== source) {
    source = from;
    buffer = NO_MARGINS;
    last = null;
    asking = null;
  }
  const next = shown(state.stream).stability;
  if (!next && last) {
    // A replay went back to before the first of them.
    buffer = NO_MARGINS;
    last = null;
    asking = null;
  }
  if (next && next !== last) {
    const replay = state.stream.replayState?.id;
    if (replay !== undefined && isJump(last?.onboard_ms ?? null, next.onboard_ms)) void ask(replay);
    last = next;
    buffer = withSample(buffer, sampleOf(next));
  }
  if (useMarginHistory.getState().samples !== buffer.samples) {
    useMarginHistory.setState({ samples: buffer.samples });
  }
}

/** Gathers until the returned function is called. */
export function startMargins(): () => void {
  gather(useConsole.getState());
  return useConsole.subscribe(gather);
}
