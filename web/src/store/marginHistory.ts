// Gathers the margins of what is shown, live or replayed; begins anew when the source changes.

import { create } from "zustand";

import type { StabilityDerived } from "../api/types";
import { type MarginBuffer, type MarginSample, NO_MARGINS, withSample } from "../lib/marginBuffer";
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

const sourceOf = ({ stream, logId }: ConsoleState) =>
  stream.replayState ? `replay ${stream.replayState.id}` : `live ${logId ?? ""}`;

function gather(state: ConsoleState): void {
  const from = sourceOf(state);
  if (from !== source) {
    source = from;
    buffer = NO_MARGINS;
    last = null;
  }
  const next = shown(state.stream).stability;
  if (next && next !== last) {
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
