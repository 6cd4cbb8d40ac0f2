// Full width when the ground server is out of reach: nothing can be sent, and why. And a calm line while a
// log is being opened.

import { localNow } from "../../api/stream";
import { fileSize } from "../../lib/format";
import { formatDayTime, formatSpan, parseOptional } from "../../lib/time";
import { carrierDown, carrierWords } from "../../store/carrier";
import { retryNow, useConsole } from "../../store/console";
import { useServerNow } from "../../store/now";
import { cancelOpening, useLogs } from "../../store/replay";
import { StatusMark } from "../../ui/StatusMark";
import { LogFails } from "./LogFails";
import { Silence } from "./Silence";
import "./banner.css";

export function Banner() {
  const lost = useConsole((s) => s.connection === "lost");
  return (
    <>
      {lost && <Lost />}
      {!lost && <RoverLost />}
      {!lost && <Silence />}
      {!lost && <LogFails />}
      <Opening />
    </>
  );
}

/** How far the opening of a log is; what is shown stays until it is open. */
function Opening() {
  const opening = useLogs((s) => s.opening);
  const log = useLogs((s) => s.logs?.find((l) => l.id === opening?.log));
  if (!opening) return null;
  const start = parseOptional(log?.start);
  const share = opening.job?.progress ?? 0;
  return (
    <div className="opening" role="status" data-testid="opening">
      <span>
        Opening the log
        {start !== null && <span className="num"> {formatDayTime(start)}</span>}
      </span>
      {log && <span className="quiet num">{fileSize(log.size)}</span>}
      <div className="bar">
        <span style={{ width: `${Math.round(share * 100)}%` }} />
      </div>
      <span className="quiet">{opening.job?.doing ?? "asks for it"}</span>
      <button type="button" className="button" data-testid="opening-cancel" onClick={cancelOpening}>
        Cancel
      </button>
    </div>
  );
}

/** The server is there, the rover's process is not. */
function RoverLost() {
  const now = useServerNow();
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const down = useConsole((s) => carrierDown(s.stream.live));
  if (!down || replaying) return null;
  const heard = parseOptional(down.heard);
  return (
    <div className="banner" data-testid="rover-banner" data-state={down.state}>
      <StatusMark status="critical" />
      <strong role="alert">{carrierWords(down)}.</strong>
      <span>
        {heard === null
          ? "Nothing was heard from the rover yet"
          : `Last heard ${formatSpan(Math.max(0, (now - heard) / 1000))} ago`}
        , at {down.address}. No command is handed over; an E-stop waits for the rover.
      </span>
      {down.why && <span className="quiet">{down.why}</span>}
    </div>
  );
}

function Lost() {
  useServerNow();
  const retryAt = useConsole((s) => s.retryAt_ms);
  const left_s = (retryAt - localNow()) / 1000;
  return (
    <div className="banner" data-testid="banner">
      <StatusMark status="critical" />
      <strong role="alert">No connection to the ground server.</strong>
      <span>What is shown is old, and nothing can be sent.</span>
      <span className="num">
        {left_s > 0 ? `Next attempt in ${formatSpan(left_s)}` : "Trying…"}
      </span>
      <span className="banner-space" />
      <button type="button" className="button" onClick={retryNow}>
        Try now
      </button>
    </div>
  );
}
