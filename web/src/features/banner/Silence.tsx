// Full width while the rover is not heard: since when, what is known of why, and what becomes of commands.

import type { Outage } from "../../api/types";
import { formatClock, formatSpan, parseTime } from "../../lib/time";
import { carrierDown } from "../../store/carrier";
import { useConsole } from "../../store/console";
import { useServerNow } from "../../store/now";
import { outageAt } from "../../lib/linkModel";
import { StatusMark } from "../../ui/StatusMark";

/** A shorter silence is told by the age in the bar alone (s). */
const WORTH_TELLING_S = 3;

export function Silence() {
  const now = useServerNow();
  const live = useConsole((s) => s.stream.live);
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const rover = live.rover;
  // Where the rover's process is gone, its own line tells more.
  if (replaying || !rover || carrierDown(live)) return null;
  if (now - rover.received_ms < WORTH_TELLING_S * 1000) return null;
  const config = live.link?.message.config;
  const down = outageAt(config?.down, now);
  const up = outageAt(config?.up, now);
  return (
    <div className="banner quiet-link" data-testid="silence">
      <StatusMark status="serious" />
      <strong role="alert">
        No telemetry for {formatSpan(Math.max(0, (now - rover.received_ms) / 1000))}.
      </strong>
      <span>
        What is shown was true on board {formatSpan(Math.max(0, (now - rover.onboard_ms) / 1000))}{" "}
        ago.{" "}
        {down
          ? `The link is in an outage until ${formatClock(parseTime(down.end))} UTC, as set.`
          : "No outage is set: why is not known."}{" "}
        {commandsNow(up)}
      </span>
    </div>
  );
}

function commandsNow(up: Outage | null): string {
  if (!up) return "Commands and an E-stop are sent; what comes of them is told once it is heard.";
  const end = formatClock(parseTime(up.end));
  return up.traffic === "hold"
    ? `Commands and an E-stop wait until ${end} UTC.`
    : `Commands sent before ${end} UTC are lost; an E-stop is repeated.`;
}
