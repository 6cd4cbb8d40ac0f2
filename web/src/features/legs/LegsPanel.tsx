// The legs: choose one, see which stand, and how stable the stance is.

import { capital, legLabel, metres, readable } from "../../lib/format";
import { shortly } from "../../lib/margins";
import { feetLabel, feetOf, regionOf } from "../../lib/regions";
import { useChannels, useConsole } from "../../store/console";
import { chooseLeg, useSelection } from "../../store/selection";
import { useView } from "../../store/view";
import { MarginDial } from "../telemetry/MarginDial";
import "./legs.css";

export function LegsPanel() {
  const legs = useConsole((s) => s.model?.legs);
  const chosen = useSelection((s) => s.leg);
  const contacts = useChannels((c) => c.rover?.message.contacts);
  return (
    <section className="section stack" aria-label="Legs">
      <div className="leg-buttons of-rover" role="group" aria-label="Choose a leg">
        {legs?.map((leg, i) => (
          <button
            key={leg.name}
            type="button"
            className="leg-button"
            data-testid={`leg-${leg.name}`}
            aria-pressed={chosen === leg.name}
            aria-label={`${capital(legLabel(leg.name))}, ${contacts?.[leg.name] ? "stands" : "lifted"}`}
            title={`${capital(legLabel(leg.name))} (key ${i + 1}): ${contacts?.[leg.name] ? "stands" : "lifted"}`}
            onClick={() => chooseLeg(chosen === leg.name ? null : leg.name)}
          >
            {leg.name.replace(/\D+/, "") || leg.name}
            <i className={contacts?.[leg.name] ? "foot down" : "foot"} aria-hidden />
          </button>
        ))}
      </div>
      {!legs && <p className="quiet">Waiting for the rover's model.</p>}
    </section>
  );
}

export function StancePanel() {
  const stability = useChannels((c) => c.stability?.message ?? null);
  const model = useConsole((s) => s.model);
  if (!stability || !model) {
    return (
      <section className="section" aria-label="Stability">
        <p className="quiet">No stability known yet.</p>
      </section>
    );
  }
  const { regular, settlement_margin_m, settlement_leg } = stability;
  const critical = readable(regular?.critical ?? "");
  return (
    <section className="section stance of-rover" aria-label="Stability">
      <div className="row between">
        <h2>Stability margin</h2>
        <button
          type="button"
          className="button bare all-margins"
          title="Every margin, and how they went"
          data-testid="all-margins"
          onClick={() => useView.setState({ tab: "stability", rightOpen: true })}
        >
          All
        </button>
      </div>
      <MarginDial margin_m={regular?.margin_m ?? null} needed_m={model.margin_m}>
        {regular?.critical && (
          <span data-testid="critical-edge" title={`Decided by ${critical}`}>
            at {feetLabel(feetOf(regular.critical))}
          </span>
        )}
      </MarginDial>
      <dl className="facts">
        <dt title="Margin should any one leg slip">conservative</dt>
        <dd className="num">{shortly(regionOf(stability, "conservative"))}</dd>
        <dt title="Margin within what friction of the contacts holds">friction</dt>
        <dd className="num">{shortly(regionOf(stability, "friction"))}</dd>
        <dt title={settlement_leg ? `Worst: ${legLabel(settlement_leg)}` : undefined}>
          after settling
        </dt>
        <dd className="num">{metres(settlement_margin_m)}</dd>
      </dl>
    </section>
  );
}
