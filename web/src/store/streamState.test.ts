import { describe, expect, it } from "vitest";

import type { CommandRecord, ReplayState, StreamFrame } from "../api/types";
import { withHello, withPong, NO_ESTIMATE } from "./clock";
import {
  closeReplay,
  isLater,
  NO_STREAM,
  openReplay,
  reduce,
  shown,
  type StreamState,
} from "./streamState";

const at = (s: number) => new Date(Date.UTC(2026, 10, 23, 15) + 1000 * s).toISOString();

function message(channel: string, body: unknown, sequence = 1, replay?: string): StreamFrame {
  const frame = {
    op: "message" as const,
    channel,
    sequence,
    onboard_time: at(0),
    sent_time: at(0),
    received_time: at(1.3),
    message: body,
  };
  return replay === undefined ? frame : { ...frame, replay };
}

const event = (id: string, state: string) => ({
  command: { id, state: "staged" },
  state,
  who: "o",
});

const replay = (id: string, s: number): ReplayState => ({
  id,
  log: "l",
  start: at(0),
  end: at(100),
  at: at(s),
  rate: 1,
  paused: false,
  ended: false,
});

const fold = (state: StreamState, ...frames: StreamFrame[]) => frames.reduce(reduce, state);

describe("the stream's fold", () => {
  it("keeps the latest of each channel with both of its times", () => {
    const state = fold(
      NO_STREAM,
      message("rover/state", { mode: "idle" }, 1),
      message("rover/state", { mode: "executing" }, 2),
    );
    expect(state.live.rover).toMatchObject({ sequence: 2, message: { mode: "executing" } });
    expect(state.live.rover!.received_ms - state.live.rover!.onboard_ms).toBe(1300);
  });

  it("a command is the fold of its events, in order of staging", () => {
    const state = fold(
      NO_STREAM,
      message("command/event", event("a", "staged"), 1),
      message("command/event", event("b", "staged"), 2),
      message("command/event", event("a", "armed"), 3),
    );
    expect(state.live.commands.map((c: CommandRecord) => `${c.id} ${c.state}`)).toEqual([
      "a armed",
      "b staged",
    ]);
  });

  it("counts gaps by source", () => {
    const open = openReplay(NO_STREAM, replay("r", 0));
    const state = fold(
      open,
      { op: "gap", missed: 3 },
      { op: "gap", missed: 4, replay: "r" },
      { op: "gap", missed: 9, replay: "old" },
    );
    expect([state.live.missed, state.replay?.missed]).toEqual([3, 4]);
  });

  it("live and replay never mix, and an old replay's messages are dropped", () => {
    const open = openReplay(NO_STREAM, replay("r", 0));
    const state = fold(
      open,
      message("rover/state", { mode: "idle" }, 1),
      message("rover/state", { mode: "fault" }, 1, "r"),
      message("rover/state", { mode: "stopped" }, 1, "other"),
    );
    expect(state.live.rover?.message.mode).toBe("idle");
    expect(shown(state).rover?.message.mode).toBe("fault");
    expect(shown(closeReplay(state)).rover?.message.mode).toBe("idle");
    expect(fold(NO_STREAM, message("rover/state", {}, 1, "r"))).toEqual(NO_STREAM);
  });

  it("going back in a replay un-happens commands and telemetry, going on does not", () => {
    const open = fold(
      openReplay(NO_STREAM, replay("r", 50)),
      message("rover/state", { mode: "idle" }, 1, "r"),
      message("command/event", event("a", "done"), 1, "r"),
    );
    const on = fold(open, { op: "replay", state: replay("r", 51) });
    expect(on.replay?.commands.length).toBe(1);
    expect(on.replay?.rover?.message.mode).toBe("idle");
    const back = fold(open, { op: "replay", state: replay("r", 1) });
    expect(back.replay?.commands).toEqual([]);
    expect(back.replay?.rover).toBeNull();
    // What the server told again before it told the new place stays.
    const later = fold(open, { op: "replay", state: replay("r", 10) });
    expect(later.replay?.commands.length).toBe(1);
    expect(fold(open, { op: "replay", state: replay("other", 10) })).toBe(open);
  });

  it("events are kept newest first, once each, and not without bound", () => {
    let state = NO_STREAM;
    for (let n = 1; n <= 300; n++)
      state = fold(state, message("event", { level: "info", text: `${n}` }, n));
    state = fold(state, message("event", { level: "info", text: "again" }, 300));
    expect(state.live.events.length).toBe(200);
    expect(state.live.events[0]?.message.text).toBe("300");
  });
});

describe("an answer that comes after the stream's word", () => {
  it("does not turn a command back", () => {
    expect(isLater("received", "sent")).toBe(true);
    expect(isLater("done", "sent")).toBe(true);
    expect(isLater("staged", "armed")).toBe(false);
    expect(isLater("armed", "armed")).toBe(false);
  });
});

describe("the server's clock", () => {
  it("is taken from hello until a pong says it better", () => {
    const first = withHello(NO_ESTIMATE, 5000, 4000);
    expect(first.offset_ms).toBe(1000);
    const better = withPong(first, 5000, 4000, 4100);
    expect(better).toEqual({ offset_ms: 950, round_trip_ms: 100 });
    expect(withHello(better, 9000, 4000)).toBe(better);
  });

  it("a slow pong does not spoil it", () => {
    const good = withPong(NO_ESTIMATE, 5000, 4000, 4010);
    expect(withPong(good, 9000, 4000, 5000).offset_ms).toBe(good.offset_ms);
    expect(withPong(good, NaN, 4000, 4001)).toBe(good);
  });
});
