// The link: up or down, its delay each way, changeable while it runs.

import { ArrowDown, ArrowUp } from "lucide-react";
import { useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { LinkConfig, LinkCounters } from "../../api/types";
import { formatSpan } from "../../lib/time";
import { carrierDown } from "../../store/carrier";
import { useChannels, useConsole } from "../../store/console";
import { Popover } from "../../ui/Popover";
import { StatusMark } from "../../ui/StatusMark";

export function LinkMenu() {
  const connection = useConsole((s) => s.connection);
  const link = useChannels((c) => c.link?.message ?? null);
  const down = useChannels((c) => carrierDown(c));
  const label = (
    <>
      <StatusMark
        status={
          down || connection === "lost" ? "critical" : connection === "open" ? "normal" : "off"
        }
      />
      <span>
        {connection === "lost"
          ? "No link"
          : connection !== "open"
            ? "Connecting"
            : down
              ? "No rover"
              : "Link"}
      </span>
      {link && (
        <span className="num quiet row link-delays" data-testid="delays">
          <ArrowUp size={12} aria-label="up" />
          {formatSpan(link.config.up_delay_s)}
          <ArrowDown size={12} aria-label="down" />
          {formatSpan(link.config.down_delay_s)}
        </span>
      )}
    </>
  );
  return (
    <Popover label={label} title="Link and its delays" testId="link">
      {() =>
        link ? (
          <>
            <Delays
              key={`${link.config.up_delay_s}|${link.config.down_delay_s}`}
              config={link.config}
            />
            <div className="section">
              <table className="link-table num">
                <thead>
                  <tr>
                    <th />
                    <th>sent</th>
                    <th>arrived</th>
                    <th>dropped</th>
                    <th>under way</th>
                  </tr>
                </thead>
                <tbody>
                  <Counters name="up" counters={link.up} />
                  <Counters name="down" counters={link.down} />
                </tbody>
              </table>
            </div>
          </>
        ) : (
          <p className="empty">The server has not told of the link yet.</p>
        )
      }
    </Popover>
  );
}

function Counters({ name, counters }: { name: string; counters: LinkCounters }) {
  return (
    <tr>
      <th>{name}</th>
      <td>{counters.sent}</td>
      <td>{counters.delivered}</td>
      <td>{counters.dropped}</td>
      <td>{counters.in_flight}</td>
    </tr>
  );
}

function Delays({ config }: { config: LinkConfig }) {
  const [up, setUp] = useState(String(config.up_delay_s));
  const [down, setDown] = useState(String(config.down_delay_s));
  const [failure, setFailure] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const connected = useConsole((s) => s.connection === "open");
  const blocked = replaying || !connected;
  const draft = { up_delay_s: Number(up), down_delay_s: Number(down) };
  const good = [up, down].every((t) => t !== "" && Number(t) >= 0 && Number(t) <= 1800);
  const changed =
    draft.up_delay_s !== config.up_delay_s || draft.down_delay_s !== config.down_delay_s;

  const apply = async () => {
    setBusy(true);
    setFailure(null);
    try {
      await api.putLink(draft);
    } catch (error) {
      setFailure(sentenceOf(error));
    } finally {
      setBusy(false);
    }
  };

  return (
    <form
      className="section stack"
      onSubmit={(event) => {
        event.preventDefault();
        void apply();
      }}
    >
      <DelayField label="Up: commands" testId="delay-up" value={up} onChange={setUp} />
      <DelayField label="Down: telemetry" testId="delay-down" value={down} onChange={setDown} />
      {failure && <p className="trouble small">{failure}</p>}
      <div className="row between">
        <span className="quiet small">Moon 1.3 s, at most 1800 s</span>
        <button
          type="submit"
          className="button"
          data-testid="delay-apply"
          disabled={!good || !changed || busy || blocked}
          title={blocked ? "Only with the live rover" : undefined}
        >
          Set delays
        </button>
      </div>
    </form>
  );
}

interface FieldProps {
  label: string;
  testId: string;
  value: string;
  onChange: (seconds: string) => void;
}

function DelayField({ label, testId, value, onChange }: FieldProps) {
  return (
    <div className="field">
      {label} (s)
      <div className="row">
        <input
          type="range"
          min={0}
          max={10}
          step={0.1}
          value={Math.min(10, Number(value))}
          aria-label={`${label}, slider (s)`}
          onChange={(event) => onChange(event.target.value)}
        />
        <input
          type="number"
          className="num delay-number"
          min={0}
          max={1800}
          step={0.1}
          value={value}
          aria-label={`${label} (s)`}
          data-testid={testId}
          onChange={(event) => onChange(event.target.value)}
        />
      </div>
    </div>
  );
}
