// What waits for this operator, whatever panel is open: a word on somebody's command, an outcome that nobody
// knows, a request for the authority. Empty it is not there.

import { mayApprove } from "../../lib/approval";
import { formatSpan } from "../../lib/time";
import { handOverAuthority, useAuthority, useAuthorityRequests } from "../../store/authority";
import { useConsole, useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { useView } from "../../store/view";
import { StatusMark } from "../../ui/StatusMark";
import { ToApprove } from "./ToApprove";
import { Unresolved } from "./Unresolved";
import "./attention.css";

export function Attention() {
  const commands = useLive((c) => c.commands);
  const operator = useView((s) => s.operator);
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const view = useAuthority();
  const dismissed = useAuthorityRequests((s) => s.dismissed);
  const now = useServerNow();
  if (replaying) return null;
  const unknown = commands.filter((c) => c.state === "overdue");
  const waiting = commands.filter((c) => mayApprove(c, operator, now));
  const asked = view.holder === "mine" && view.asked?.by !== dismissed ? view.asked : null;
  if (unknown.length + waiting.length === 0 && !asked) return null;
  return (
    <section className="attention" aria-label="Needs you" data-testid="attention">
      {asked && <Asked by={asked.by} left_s={asked.left_s} />}
      {waiting.map((command) => (
        <ToApprove key={command.id} command={command} />
      ))}
      {unknown.map((command) => (
        <Unresolved key={command.id} command={command} now_ms={now} />
      ))}
    </section>
  );
}

function Asked({ by, left_s }: { by: string; left_s: number }) {
  const busy = useAuthorityRequests((s) => s.busy);
  return (
    <div className="section stack" data-testid="asked-for">
      <p className="row">
        <StatusMark status="standby" />
        <span>
          <strong>{by}</strong> asks for the authority{" "}
          <span className="num quiet">{formatSpan(left_s)}</span>
        </span>
      </p>
      <div className="row between">
        <button
          type="button"
          className="button bare"
          onClick={() => useAuthorityRequests.setState({ dismissed: by })}
        >
          Not now
        </button>
        <button
          type="button"
          className="button primary"
          data-testid="asked-hand-over"
          disabled={busy}
          onClick={() => void handOverAuthority(by)}
        >
          Hand over to {by}
        </button>
      </div>
    </div>
  );
}
