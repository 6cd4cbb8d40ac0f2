// Full width when the ground server is out of reach: nothing can be sent, and why.

import { localNow } from "../../api/stream";
import { formatSpan } from "../../lib/time";
import { retryNow, useConsole } from "../../store/console";
import { useServerNow } from "../../store/now";
import { StatusMark } from "../../ui/StatusMark";
import "./banner.css";

export function Banner() {
  const lost = useConsole((s) => s.connection === "lost");
  return lost ? <Lost /> : null;
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
