import { describe, expect, it } from "vitest";

import type { CommandRecord, CommandState } from "../api/types";
import { commandClock } from "./commandClock";

const T0 = Date.UTC(2026, 10, 23, 15);
const at = (s: number) => new Date(T0 + 1000 * s).toISOString();

/** Sent at 0, 1.3 s each way, overdue after 5 s. */
function command(state: CommandState): CommandRecord {
  return {
    id: "c",
    body: { type: "stop" },
    title: "Lift leg 2",
    state,
    operator: "o",
    staged: at(-20),
    armed_until: at(10),
    sent: at(0),
    arrives: at(1.3),
    earliest_ack: at(2.6),
    overdue_after: at(5),
    duration_s: 4,
    progress: 0.25,
  };
}

const waits = (state: CommandState, s: number) => commandClock(command(state), T0 + 1000 * s).waits;

describe("the two light-time clocks", () => {
  it("first the way up, then the way back, then overdue", () => {
    expect(waits("sent", 0)).toBe("arrives in 1.3 s");
    expect(waits("sent", 1)).toBe("arrives in 0.3 s");
    expect(waits("sent", 1.3)).toBe("earliest ack in 1.3 s");
    expect(waits("sent", 2.6)).toBe("ack due, overdue in 2.4 s");
    expect(waits("sent", 9)).toBe("ack due");
  });

  it("success is never shown before the rover said so", () => {
    expect(commandClock(command("sent"), T0 + 60_000).word).toBe("sent");
  });

  it("the share grows from sending to the earliest ack and stays", () => {
    const share = (s: number) => commandClock(command("sent"), T0 + 1000 * s).share;
    expect([share(0), share(1.3), share(2.6), share(60)]).toEqual([0, 0.5, 1, 1]);
  });

  it("an armed command may be sent until its time has run out", () => {
    const clock = commandClock(command("armed"), T0 + 4000);
    expect([clock.armed_s, clock.recallable]).toEqual([6, true]);
    expect(commandClock(command("armed"), T0 + 10_000).armed_s).toBe(0);
  });

  it("what has left cannot be taken back, what is overdue is not called lost", () => {
    expect(commandClock(command("sent"), T0).recallable).toBe(false);
    expect(waits("overdue", 6)).toContain("unknown");
    expect(waits("executing", 3)).toBe("25 % as last reported");
  });

  it("a record without times says only its state", () => {
    const bare = { ...command("sent"), sent: undefined, arrives: undefined };
    expect(commandClock(bare as CommandRecord, T0)).toMatchObject({ word: "sent", waits: null });
  });
});
