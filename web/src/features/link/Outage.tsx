// An outage for trials: nothing goes either way for a while; what is under way still arrives.

import { useState } from "react";

import type { LinkConfig } from "../../api/types";
import { beginOutage, endOutage, type Traffic } from "../../lib/linkModel";
import { formatSpan } from "../../lib/time";
import { serverNow } from "../../store/clock";
import { Segments } from "../../ui/Segments";
import { useLinkChange } from "./useLinkChange";
import { useOutage } from "./useOutage";

const TRAFFIC: [Traffic, string, string][] = [
  ["hold", "It waits", "What is to be sent waits in its queue for the end"],
  ["lose", "It is lost", "What would be transmitted is lost, and the sending end does not know"],
];

/** Longest outage from here (s): an hour. */
const MOST_S = 3600;

export function Outage({ config }: { config: LinkConfig }) {
  const left_s = useOutage();
  const [seconds, setSeconds] = useState("30");
  const [traffic, setTraffic] = useState<Traffic>("hold");
  const { set, failure, busy, blocked } = useLinkChange();
  const value = Number(seconds);
  const good = seconds !== "" && value > 0 && value <= MOST_S;
  return (
    <section className="section stack" aria-label="Outage for trials">
      <h2>Outage for trials</h2>
      {left_s === null ? (
        <div className="link-outage">
          <label className="field">
            for (s)
            <input
              type="number"
              className="num"
              min={1}
              max={MOST_S}
              data-testid="outage-seconds"
              aria-invalid={!good}
              value={seconds}
              onChange={(event) => setSeconds(event.target.value)}
            />
          </label>
          <Segments
            name="outage-traffic"
            label="What becomes of what is sent meanwhile"
            choices={TRAFFIC}
            value={traffic}
            set={setTraffic}
            testId="outage"
          />
          <button
            type="button"
            className="button"
            data-testid="outage-begin"
            disabled={!good || busy || blocked}
            onClick={() => void set(beginOutage(config, serverNow(), value, traffic))}
          >
            Begin
          </button>
        </div>
      ) : (
        <div className="row between">
          <span data-testid="outage-left">
            Nothing is transmitted for <span className="num">{formatSpan(left_s)}</span> more
          </span>
          <button
            type="button"
            className="button"
            data-testid="outage-end"
            disabled={busy || blocked}
            onClick={() => void set(endOutage(config, serverNow()))}
          >
            End it
          </button>
        </div>
      )}
      {failure && (
        <p className="trouble small" role="alert">
          {failure}
        </p>
      )}
    </section>
  );
}
