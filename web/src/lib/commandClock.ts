// The two light-time clocks of a command: what can be true at `now`, given what the ground knows.

import type { CommandRecord, CommandState } from "../api/types";
import { formatSpan, parseOptional } from "./time";

export interface CommandClock {
  /** The state in the words of the screen. */
  word: string;
  /** What is being waited for, with its count-down. */
  waits: string | null;
  /** Share of the present wait or motion that has passed, 0 to 1; null where nothing runs. */
  share: number | null;
  /** Seconds until the arming lapses; null unless armed. */
  armed_s: number | null;
  /** May it still be taken back on the ground? */
  recallable: boolean;
}

export const COMMAND_WORDS: Record<CommandState, string> = {
  staged: "staged",
  armed: "armed",
  sent: "sent",
  received: "received",
  executing: "executing",
  done: "done",
  failed: "failed",
  aborted: "aborted",
  overdue: "overdue",
  cancelled: "cancelled",
  expired: "expired",
};

const OPEN: ReadonlySet<CommandState> = new Set(["staged", "armed"]);
const UNDER_WAY: ReadonlySet<CommandState> = new Set(["sent", "received", "executing", "overdue"]);

export function isOpen(state: CommandState): boolean {
  return OPEN.has(state);
}

/** On its way or moving: the rover may act on it. */
export function isUnderWay(state: CommandState): boolean {
  return UNDER_WAY.has(state);
}

/** What to do about a command that has ended otherwise than done; null where there is nothing to say. */
export function wayOn({ state, plan }: Pick<CommandRecord, "state" | "plan">): string | null {
  switch (state) {
    case "expired":
      return plan
        ? "It was never sent. Plan the step anew from where the rover stands."
        : "It was never sent. Stage it again; it is checked anew.";
    case "failed":
    case "aborted":
      return plan
        ? "Look where the leg is, then plan anew or back out."
        : "Look where the rover is, then stage it again or something else.";
    case "overdue":
      return "Decide by telemetry what became of it: above, under Needs you.";
    default:
      return null;
  }
}

export function commandClock(command: CommandRecord, now_ms: number): CommandClock {
  const clock: CommandClock = {
    word: COMMAND_WORDS[command.state],
    waits: null,
    share: null,
    armed_s: null,
    recallable: isOpen(command.state),
  };
  switch (command.state) {
    case "armed":
      return armed(clock, command, now_ms);
    case "sent":
      return sent(clock, command, now_ms);
    case "received":
      return { ...clock, waits: "received, motion not reported yet" };
    case "executing":
      return {
        ...clock,
        share: clamp(command.progress),
        waits: `${Math.round(100 * clamp(command.progress))} % as last reported`,
      };
    case "overdue":
      return { ...clock, waits: "no word from the rover; the outcome is unknown" };
    default:
      return clock;
  }
}

function armed(clock: CommandClock, command: CommandRecord, now_ms: number): CommandClock {
  const until = parseOptional(command.armed_until);
  if (until === null) return clock;
  const left_s = (until - now_ms) / 1000;
  if (left_s <= 0) return { ...clock, armed_s: 0, share: 1, waits: "the arming has lapsed" };
  return {
    ...clock,
    armed_s: left_s,
    share: clamp(1 - left_s / 30),
    waits: `may be sent for ${formatSpan(left_s)}`,
  };
}

function sent(clock: CommandClock, command: CommandRecord, now_ms: number): CommandClock {
  const from = parseOptional(command.sent);
  const arrives = parseOptional(command.arrives);
  const ack = parseOptional(command.earliest_ack);
  const overdue = parseOptional(command.overdue_after);
  if (from === null || arrives === null || ack === null) return clock;
  const share = ack > from ? clamp((now_ms - from) / (ack - from)) : 1;
  if (now_ms < arrives) {
    return { ...clock, share, waits: `arrives in ${formatSpan((arrives - now_ms) / 1000)}` };
  }
  if (now_ms < ack) {
    return { ...clock, share, waits: `earliest ack in ${formatSpan((ack - now_ms) / 1000)}` };
  }
  const waits =
    overdue !== null && now_ms < overdue
      ? `ack due, overdue in ${formatSpan((overdue - now_ms) / 1000)}`
      : "ack due";
  return { ...clock, share: 1, waits };
}

function clamp(share: number): number {
  return Math.min(1, Math.max(0, share));
}
