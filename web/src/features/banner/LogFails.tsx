// Full width while the flight log does not take everything: what is lost, and what is refused meanwhile.

import { readable } from "../../lib/format";
import { useConsole } from "../../store/console";
import { StatusMark } from "../../ui/StatusMark";

export function LogFails() {
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const log = useConsole((s) => s.stream.live.link?.message.flight_log ?? null);
  if (replaying || !log?.error) return null;
  return (
    <div className="banner" data-testid="log-banner">
      <StatusMark status="critical" />
      <strong role="alert">The flight log does not take everything.</strong>
      <span>
        <span className="num">{log.dropped}</span> messages are lost to it so far. No command is
        taken until it is well again; an E-stop is.
      </span>
      <span className="quiet">{readable(log.error)}</span>
    </div>
  );
}
