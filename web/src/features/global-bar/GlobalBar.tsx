// The bar on top, left to right: mode, link and age, delays, worst status, clocks, E-stop.

import { Keyboard, Moon, Sun } from "lucide-react";
import { useEffect } from "react";

import { formatClock, formatDay, formatSpan } from "../../lib/time";
import { causesOf, type Status } from "../../store/causes";
import { useChannels, useConsole } from "../../store/console";
import { useFreshness } from "../../store/freshness";
import { useServerNow } from "../../store/now";
import { shown } from "../../store/streamState";
import { useView } from "../../store/view";
import { Popover } from "../../ui/Popover";
import { StatusMark } from "../../ui/StatusMark";
import { AuthorityMenu } from "../authority/AuthorityMenu";
import { Estop } from "../estop/Estop";
import { LinkMenu } from "../link/LinkMenu";
import { ModeMenu } from "../replay/ModeMenu";
import "./global-bar.css";

export function GlobalBar() {
  return (
    <header className="global-bar">
      <ModeMenu />
      <LinkMenu />
      <AuthorityMenu />
      <Age />
      <Health />
      <span className="global-bar-space" />
      <Clocks />
      <button
        type="button"
        className="button bare icon"
        title="Keys (?)"
        aria-label="Keys"
        data-testid="keys-open"
        onClick={() => useView.setState({ keysOpen: true })}
      >
        <Keyboard size={16} />
      </button>
      <ThemeButton />
      <Estop />
    </header>
  );
}

function Age() {
  const { age_s, stale } = useFreshness();
  // Figures of what is old are dimmed everywhere.
  useEffect(() => {
    document.documentElement.toggleAttribute("data-stale", stale);
  }, [stale]);
  return (
    <span
      className={stale ? "bar-item stale" : "bar-item"}
      data-testid="age"
      title="Time since the shown telemetry was true on board"
    >
      {age_s !== null && <span className="quiet">{stale ? "old, age" : "age"}</span>}
      <span className="num">{age_s === null ? "no telemetry" : formatSpan(age_s)}</span>
    </span>
  );
}

const WORDS: Record<Status, string> = {
  critical: "Critical",
  serious: "Serious",
  caution: "Caution",
  standby: "Note",
  normal: "Nominal",
  off: "Off",
};

function Health() {
  const { stale } = useFreshness();
  const { connection, model, stream } = useConsole.getState();
  const causes = causesOf({ connection, model, channels: shown(stream), stale });
  const worst = causes[0]?.status ?? "normal";
  const label = (
    <>
      <StatusMark status={worst} />
      <span data-testid="health">{WORDS[worst]}</span>
      {causes.length > 0 && <span className="num quiet">{causes.length}</span>}
    </>
  );
  return (
    <Popover label={label} title="What is not as it should be">
      {() => (
        <ul className="section stack" aria-live="polite">
          {causes.length === 0 && <li className="quiet">Everything is as it should be.</li>}
          {causes.map((cause) => (
            <li key={cause.text} className="row">
              <StatusMark status={cause.status} label={WORDS[cause.status]} />
              <span>{cause.text}</span>
            </li>
          ))}
        </ul>
      )}
    </Popover>
  );
}

function Clocks() {
  const now = useServerNow();
  const onboard = useChannels((c) => c.rover?.onboard_ms ?? null);
  const local = new Date(now).toLocaleString();
  return (
    <div className="clocks">
      <span className="bar-item" title={`On board when the shown telemetry was true`}>
        <span className="quiet">rover</span>
        <span className="num">{onboard === null ? "--:--:--" : formatClock(onboard, true)}</span>
      </span>
      <span className="bar-item" title={`Local time ${local}`} data-testid="clock">
        <span className="quiet">UTC</span>
        <span className="num quiet">{formatDay(now)}</span>
        <span className="num clock-now">{formatClock(now)}</span>
      </span>
    </div>
  );
}

function ThemeButton() {
  const theme = useView((s) => s.theme);
  const other = theme === "dark" ? "light" : "dark";
  return (
    <button
      type="button"
      className="button bare icon"
      title={`Use the ${other} theme`}
      aria-label={`Use the ${other} theme`}
      onClick={() => useView.setState({ theme: other })}
    >
      {theme === "dark" ? <Sun size={16} /> : <Moon size={16} />}
    </button>
  );
}
