// Stop: one action, always in the same place. Release: two steps.

import { OctagonX } from "lucide-react";

import { formatSpan } from "../../lib/time";
import { useConsole } from "../../store/console";
import {
  beginRelease,
  confirmRelease,
  stopRover,
  useEstop,
  useEstopState,
} from "../../store/estop";
import { useServerNow } from "../../store/now";
import { Ring } from "../../ui/Ring";
import { StatusMark } from "../../ui/StatusMark";
import "../banner/banner.css";
import "./estop.css";

export function Estop() {
  const reach = useConsole((s) => s.stream.live.link?.message.config.up_delay_s ?? null);
  const effect = reach === null ? "" : ` Takes effect ${formatSpan(reach)} after sending.`;
  return (
    <div className="estop-place">
      <button
        type="button"
        className="estop"
        data-testid="estop"
        aria-keyshortcuts="F9 Control+."
        title={`Stop all motion at once (F9 or Ctrl + .).${effect}`}
        onClick={() => void stopRover()}
      >
        <OctagonX size={18} aria-hidden />
        <span>E-STOP</span>
        <kbd>F9</kbd>
      </button>
    </div>
  );
}

/** Full width below the bar while an E-stop is in force: what is true now, and the way out. */
export function EstopBanner() {
  const state = useEstopState();
  const asking = useEstop((s) => s.asking);
  const now = useServerNow();
  const { takesEffect_ms, token, tokenUntil_ms, failure } = useEstop();
  const connected = useConsole((s) => s.connection === "open");
  if (failure) {
    return (
      <div className="banner" data-testid="estop-note">
        <StatusMark status="critical" />
        <strong role="alert">{failure}</strong>
        {!connected && <span className="quiet">The way to the ground server is down.</span>}
        <span className="banner-space" />
        {state !== "clear" && <Release token={null} left_s={0} asking={asking} />}
        <button
          type="button"
          className="button"
          onClick={() => useEstop.setState({ failure: null })}
        >
          Hide
        </button>
      </div>
    );
  }
  if (state === "clear") return null;
  const left_s = takesEffect_ms === null ? 0 : (takesEffect_ms - now) / 1000;
  const token_s = (tokenUntil_ms - now) / 1000;
  return (
    <div className="banner" data-testid="estop-note" data-state={state}>
      <StatusMark status="serious" />
      <EstopWords state={state} left_s={left_s} />
      <span className="banner-space" />
      {state !== "release_sent" && (
        <Release token={token_s > 0 ? token : null} left_s={token_s} asking={asking} />
      )}
    </div>
  );
}

function EstopWords({ state, left_s }: { state: string; left_s: number }) {
  if (state === "confirmed") {
    return (
      <>
        <strong role="alert">E-stop confirmed by the rover</strong>
        <span className="quiet">It refuses motion until released.</span>
      </>
    );
  }
  const what = state === "release_sent" ? "Release sent" : "E-stop sent";
  const when =
    left_s > 0 ? `takes effect in ${formatSpan(left_s)}` : "waiting for the rover's word";
  return (
    <>
      <strong role="alert">{what}</strong>
      <span className="quiet num">{when}</span>
      {state === "sent" && left_s > 0 && (
        <span className="quiet">Until then the rover does what it was told before.</span>
      )}
    </>
  );
}

function Release({
  token,
  left_s,
  asking,
}: {
  token: string | null;
  left_s: number;
  asking: boolean;
}) {
  if (token === null) {
    return (
      <button
        type="button"
        className="button"
        data-testid="estop-release"
        disabled={asking}
        onClick={() => void beginRelease()}
      >
        Release the E-stop…
      </button>
    );
  }
  return (
    <div className="row">
      <span className="row">
        <Ring left={left_s / 10} label={`${formatSpan(left_s)} left to confirm`} />
        <span className="quiet">Motion becomes possible.</span>
      </span>
      <button
        type="button"
        className="button primary"
        data-testid="estop-confirm-release"
        disabled={asking}
        onClick={() => void confirmRelease()}
      >
        Confirm release
      </button>
    </div>
  );
}
