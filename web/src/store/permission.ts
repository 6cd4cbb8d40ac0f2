// May this console send anything now, and if not, why not.

import type { CommandRecord } from "../api/types";
import { awaitsApproval } from "../lib/approval";
import { authorityView, withoutAuthority } from "../lib/authority";
import { serverNow } from "./clock";
import { carrierDown, carrierWords } from "./carrier";
import { useConsole, type ConsoleState } from "./console";
import { useServerNow } from "./now";
import { useView } from "./view";

/** The reason why nothing can be sent, or null. */
export function blockedBy(state: ConsoleState): string | null {
  if (state.stream.replayState)
    return "This is a replay: nothing can be sent. Go back to live first.";
  if (state.connection !== "open") return "No connection to the ground server.";
  const estop = state.stream.live.link?.message.estop ?? "clear";
  const down = carrierDown(state.stream.live);
  if (down) return `${carrierWords(down)}: nothing can be handed over to the rover.`;
  if (state.stream.live.link?.message.flight_log?.error)
    return "The flight log cannot be written in full: no command is taken until it can.";
  if (estop !== "clear") return "An E-stop is in force. Release it first.";
  return null;
}

export function useBlocked(): string | null {
  return useConsole(blockedBy);
}

/** Why no command can be armed or sent from here, or null; staging takes less. */
export function commandBlockedBy(state: ConsoleState, operator: string): string | null {
  const report = state.stream.live.link?.message.authority;
  return blockedBy(state) ?? withoutAuthority(authorityView(report, operator, serverNow()));
}

/** Why this command cannot be armed from here now, or null. */
export function useArmBlocked(command?: CommandRecord): string | null {
  const now = useServerNow();
  const operator = useView((s) => s.operator);
  const blocked = useConsole((s) => commandBlockedBy(s, operator));
  return blocked ?? (command ? awaitsApproval(command, now) : null);
}
