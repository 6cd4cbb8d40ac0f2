import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";

import { api } from "../api/client";
import type { ReplayMargins, ReplayState } from "../api/types";
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

const open = (id: string) => {
  const replay = { id, log: "l", start: at(0), end: at(99), at: at(0) } as ReplayState;
  useConsole.setState((state) => ({ stream: openReplay(state.stream, replay) }));
};

/** What a log has from 0 s to a time. */
const logged = (until_s: number): ReplayMargins => ({
  complete: true,
  samples: Array.from({ length: until_s + 1 }, (_, s) => ({ at: at(s), regular_m: s / 10 })),
});

describe("the history of margins", () => {
  let stop = () => {};
  beforeEach(() => {
    vi.spyOn(api, "replayMargins").mockResolvedValue({ complete: true, samples: [] });
  });
  afterEach(() => {
    stop();
    useConsole.setState({ stream: NO_STREAM });
    vi.restoreAllMocks();
  });

  it("follows what is shown and begins anew with each source", () => {
    stop = startMargins();
    for (let s = 0; s < 4; s++) tell(s, 1 + s);
    expect(regular()).toEqual([1, 2, 3]);
    expect(useMarginHistory.getState().samples[0]!.friction).toBeNaN();
    open("r");
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

  it("a jump in a replay shows what came before, at one question", async () => {
    const ask = vi.spyOn(api, "replayMargins").mockResolvedValue(logged(20));
    stop = startMargins();
    open("jumps");
    tell(20, 2, "jumps");
    tell(21, 2.1, "jumps");
    await vi.waitFor(() => expect(regular()).toHaveLength(21));
    expect(regular().slice(0, 3)).toEqual([0, 0.1, 0.2]);
    expect(regular().at(-1)).toBe(2);
    tell(22, 2.2, "jumps");
    expect(ask).toHaveBeenCalledTimes(1);
    ask.mockResolvedValue(logged(5));
    tell(5, 0.5, "jumps");
    await vi.waitFor(() => expect(regular()).toEqual([0, 0.1, 0.2, 0.3, 0.4]));
    expect(ask).toHaveBeenCalledTimes(2);
  });

  it("is empty where a replay went back to before the first frame, whatever was asked", async () => {
    let answer: (margins: ReplayMargins) => void = () => {};
    const ask = vi
      .spyOn(api, "replayMargins")
      .mockImplementation(() => new Promise((resolve) => (answer = resolve)));
    stop = startMargins();
    open("back");
    for (let s = 40; s < 44; s++) tell(s, 4, "back");
    expect(regular()).toHaveLength(3);
    for (const s of [44, 0]) {
      const state = { id: "back", log: "l", start: at(0), end: at(99), at: at(s) } as ReplayState;
      useConsole.setState((c) => ({ stream: reduce(c.stream, { op: "replay", state }) }));
    }
    expect(regular()).toEqual([]);
    answer(logged(40));
    await Promise.resolve();
    expect(regular()).toEqual([]);
    ask.mockResolvedValue(logged(2));
    tell(2, 0.2, "back");
    await vi.waitFor(() => expect(regular()).toEqual([0, 0.1]));
  });

  it("an answer that a later jump has overtaken is not shown", async () => {
    const answers: ((answer: ReplayMargins) => void)[] = [];
    const ask = vi
      .spyOn(api, "replayMargins")
      .mockImplementation(() => new Promise((resolve) => answers.push(resolve)));
    stop = startMargins();
    open("overtaken");
    tell(50, 5, "overtaken");
    tell(10, 1, "overtaken");
    tell(30, 3, "overtaken");
    expect(ask).toHaveBeenCalledTimes(1);
    answers[0]!(logged(50));
    await vi.waitFor(() => expect(ask).toHaveBeenCalledTimes(2));
    expect(regular()).toEqual([1]);
    answers[1]!(logged(30));
    await vi.waitFor(() => expect(regular()).toHaveLength(30));
  });
});
