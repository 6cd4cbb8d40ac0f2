// Who may command: in the bar on every screen, with all that can be done about it.

import { KeyRound } from "lucide-react";
import { useState } from "react";

import { type AuthorityView, leaseSentence } from "../../lib/authority";
import { formatSpan } from "../../lib/time";
import {
  askForAuthority,
  giveUpAuthority,
  handOverAuthority,
  takeAuthority,
  takeOverAuthority,
  useAuthority,
  useAuthorityRequests,
} from "../../store/authority";
import { useConsole } from "../../store/console";
import { useView } from "../../store/view";
import { Popover } from "../../ui/Popover";
import "./authority.css";

export function AuthorityMenu() {
  const view = useAuthority();
  const replaying = useConsole((s) => s.stream.replayState !== null);
  if (replaying) return null;
  const label = (
    <>
      <KeyRound size={14} aria-hidden />
      <span className={view.holder === "mine" ? "" : "quiet"} data-testid="authority-word">
        {chipWord(view)}
      </span>
    </>
  );
  return (
    <Popover label={label} title="Who may command" testId="authority">
      {() => <Menu view={view} />}
    </Popover>
  );
}

function chipWord(view: AuthorityView): string {
  if (view.holder === "mine") return view.asked ? `${view.asked.by} asks` : "You command";
  return view.holder === "theirs" ? `${view.name} commands` : "Nobody commands";
}

function Menu({ view }: { view: AuthorityView }) {
  const failure = useAuthorityRequests((s) => s.failure);
  return (
    <div className="authority" data-testid="authority-menu" data-holder={view.holder}>
      <section className="section stack">
        <div className="row between">
          <strong>{heading(view)}</strong>
          {view.left_s !== null && (
            <span className="num quiet" data-testid="lease-left" title="Until it lapses">
              {formatSpan(view.left_s)}
            </span>
          )}
        </div>
        {view.left_s !== null && (
          <div className="bar" aria-hidden>
            <span style={{ width: `${(100 * view.left).toFixed(1)}%` }} />
          </div>
        )}
        <p className="quiet small">{leaseSentence(view)}</p>
        <Actions key={`${view.holder} ${view.name}`} view={view} />
        {failure && (
          <p className="trouble small" role="alert">
            {failure}
          </p>
        )}
      </section>
      <OwnName view={view} />
      <p className="section quiet small">
        When it lapses or passes on, what is armed is staged again; what was sent goes on. Looking,
        planning, staging and the E-stop never need it.
      </p>
    </div>
  );
}

function heading(view: AuthorityView): string {
  if (view.holder === "mine") return "You have the authority";
  return view.holder === "theirs" ? `${view.name} has the authority` : "Nobody has the authority";
}

function Actions({ view }: { view: AuthorityView }) {
  const connected = useConsole((s) => s.connection === "open");
  const busy = useAuthorityRequests((s) => s.busy);
  const off = busy || !connected;
  switch (view.holder) {
    case "nobody":
      return (
        <button
          type="button"
          className="button primary"
          data-testid="authority-take"
          disabled={off}
          onClick={() => void takeAuthority()}
        >
          Take the authority
        </button>
      );
    case "mine":
      return <Holding view={view} off={off} />;
    case "theirs":
      return <Wanting view={view} off={off} />;
  }
}

function Holding({ view, off }: { view: AuthorityView; off: boolean }) {
  const [to, setTo] = useState("");
  const name = to.trim();
  return (
    <>
      {view.asked && <Asked by={view.asked.by} left_s={view.asked.left_s} off={off} />}
      <form
        className="row"
        onSubmit={(event) => {
          event.preventDefault();
          if (name !== "") void handOverAuthority(name);
        }}
      >
        <label className="field authority-to">
          Hand over to
          <input
            type="text"
            maxLength={64}
            placeholder="operator's name"
            data-testid="authority-to"
            value={to}
            onChange={(event) => setTo(event.target.value)}
          />
        </label>
        <button
          type="submit"
          className="button authority-low"
          data-testid="authority-hand-over"
          disabled={off || name === ""}
        >
          Hand over
        </button>
      </form>
      <button
        type="button"
        className="button"
        data-testid="authority-release"
        disabled={off}
        onClick={() => void giveUpAuthority()}
      >
        Give it up
      </button>
    </>
  );
}

/** Somebody asks its holder for it. */
function Asked({ by, left_s, off }: { by: string; left_s: number; off: boolean }) {
  return (
    <div className="row between">
      <span>
        {by} asks for it <span className="num quiet">{formatSpan(left_s)}</span>
      </span>
      <button
        type="button"
        className="button primary"
        data-testid="authority-give"
        disabled={off}
        onClick={() => void handOverAuthority(by)}
      >
        Hand over
      </button>
    </div>
  );
}

function Wanting({ view, off }: { view: AuthorityView; off: boolean }) {
  const [sure, setSure] = useState(false);
  const own = useView((s) => s.operator);
  const asked = view.asked?.by === own ? view.asked : null;
  if (sure) {
    return (
      <>
        <p className="small">
          Take over only if {view.name} cannot answer: what {view.name} has armed is staged again,
          and everybody is told.
        </p>
        <div className="row between">
          <button type="button" className="button" autoFocus onClick={() => setSure(false)}>
            Leave it
          </button>
          <button
            type="button"
            className="button primary"
            data-testid="authority-take-over-sure"
            disabled={off}
            onClick={() => void takeOverAuthority()}
          >
            Take over from {view.name}
          </button>
        </div>
      </>
    );
  }
  return (
    <>
      <div className="row between">
        <button
          type="button"
          className="button primary"
          data-testid="authority-ask"
          disabled={off || asked !== null}
          onClick={() => void askForAuthority()}
        >
          {asked ? "Asked" : "Ask for it"}
        </button>
        <button
          type="button"
          className="button"
          data-testid="authority-take-over"
          disabled={off}
          onClick={() => setSure(true)}
        >
          Take over…
        </button>
      </div>
      {asked && (
        <p className="quiet small" data-testid="authority-asked">
          {view.name} sees it for <span className="num">{formatSpan(asked.left_s)}</span>
        </p>
      )}
    </>
  );
}

/** What this operator is called: the name that goes with every request. */
function OwnName({ view }: { view: AuthorityView }) {
  const operator = useView((s) => s.operator);
  const [draft, setDraft] = useState(operator);
  const name = draft.trim();
  const usable = /^[\x20-\x7e]{1,64}$/.test(name);
  const mine = view.holder === "mine";
  return (
    <form
      className="section row"
      onSubmit={(event) => {
        event.preventDefault();
        if (usable && !mine) useView.setState({ operator: name });
      }}
    >
      <label
        className="field authority-to"
        title={mine ? "Give the authority up to change your name" : "Others see you by this name"}
      >
        Your name
        <input
          type="text"
          maxLength={64}
          data-testid="operator-name"
          disabled={mine}
          aria-invalid={!usable}
          value={draft}
          onChange={(event) => setDraft(event.target.value)}
        />
      </label>
      <button
        type="submit"
        className="button authority-low"
        data-testid="operator-save"
        disabled={mine || !usable || name === operator}
      >
        Save
      </button>
    </form>
  );
}
