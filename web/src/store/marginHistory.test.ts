import { afterEach, describe, expect, it } from "vitest";

import type { ReplayState } from "../api/types";
import { useConsole } from "./console";
import { startMargins, useMarginHistory } from "./marginHistory";
import { NO_STREAM, openReplay, reduce } from "./streamState";

const at = (s: number) => new Date(Date.UTC(2026, 10, 23, 15) + 1000 * s).toISOString();

function tell(s: number, margin_m: number, replay?: string): void {
  const frame = {
    op: "message" as const,
    channel: "rover/stability",
    sequence: s,
    onboard_time: at(s),
    sent_time: at(s),
    received_time: at(s + 1.3),
    message: { regular: { margin_m }, conservative_kind: "empty", forces: null },
    ...(replay !== undefined && { replay }),
  };
  useConsole.setState((state) => ({ stream: reduce(state.stream, frame) }));
}

const regular = () => useMarginHistory.getState().samples.map((s) => s.regular);

describe("the history of margins", () => {
  let stop = () => {};
  afterEach(() => {
    stop();
    useConsole.setState({ stream: NO_STREAM });
  });

  it("follows what is shown and begins anew with each source", () => {
    stop = startMargins();
    for (let s = 0; s < 4; s++) tell(s, 1 + s);
    expect(regular()).toEqual([1, 2, 3]);
    expect(useMarginHistory.getState().samples[0]!.friction).toBeNaN();
    const replay = { id: "r", log: "l", start: at(0), end: at(9), at: at(0) } as ReplayState;
    useConsole.setState((state) => ({ stream: openReplay(state.stream, replay) }));
    expect(regular()).toEqual([]);
    for (let s = 0; s < 3; s++) tell(s, 7, "r");
    tell(9, 1);
    expect(regular()).toEqual([7, 7]);
  });

  it("does not change with what is no news", () => {
    stop = startMargins();
    for (let s = 0; s < 3; s++) tell(s, 1);
    const { samples } = useMarginHistory.getState();
    useConsole.setState({ retryAt_ms: 1 });
    expect(useMarginHistory.getState().samples).toBe(samples);
  });
});
