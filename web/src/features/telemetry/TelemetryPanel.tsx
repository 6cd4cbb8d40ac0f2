// The rover in figures: contact, force and torque of each leg against the limits.

import { legLabel, newtons, percent, readable } from "../../lib/format";
import { fullScale } from "../../lib/loads";
import { useChannels, useConsole } from "../../store/console";
import { LimitBar } from "../../ui/LimitBar";
import { StatusMark } from "../../ui/StatusMark";
import { LoadBar } from "./LoadBar";
import "./telemetry.css";

export function TelemetryPanel() {
  const model = useConsole((s) => s.model);
  const rover = useChannels((c) => c.rover?.message ?? null);
  const stability = useChannels((c) => c.stability?.message ?? null);
  if (!model || !rover) return <p className="section quiet">No telemetry has come yet.</p>;
  const bands = stability?.forces?.load_share_n ?? null;
  const full_n = fullScale(rover.wheel_forces_n, bands);
  return (
    <>
      <section className="section stack of-rover">
        <div className="row between">
          <span>
            Rover is <strong data-testid="rover-mode">{rover.mode}</strong>
          </span>
          <span className="quiet small num">{model.mass_kg.toFixed(0)} kg</span>
        </div>
        {rover.fault && <p className="trouble">{rover.fault}</p>}
      </section>
      <section className="section of-rover">
        <table className="telemetry">
          <thead>
            <tr>
              <th>leg</th>
              <th colSpan={2} title="Measured, within what springy legs would carry">
                load
              </th>
              <th colSpan={2} title="Largest torque of a joint, of its limit">
                torque
              </th>
            </tr>
          </thead>
          <tbody>
            {model.legs.map((leg) => {
              const ratios = stability?.torque_ratios[leg.name] ?? [];
              const worst = ratios.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a), 0);
              const force = rover.wheel_forces_n[leg.name];
              const stands = rover.contacts[leg.name] ?? false;
              const said = stands ? "stands" : "lifted";
              return (
                <tr key={leg.name}>
                  <th scope="row" title={said}>
                    <span className="row">
                      <StatusMark status={stands ? "normal" : "off"} label={said} />
                      {legLabel(leg.name)}
                    </span>
                  </th>
                  <td>
                    <LoadBar
                      leg={legLabel(leg.name)}
                      measured_n={force && stands ? force[2] : null}
                      band_n={bands?.[leg.name] ?? null}
                      full_n={full_n}
                    />
                  </td>
                  <td className={stands ? "num right" : "quiet small right"}>
                    {stands ? (force ? newtons(Math.hypot(...force)) : "–") : "lifted"}
                  </td>
                  <td>
                    <LimitBar ratio={worst} label={`Largest torque of ${legLabel(leg.name)}`} />
                  </td>
                  <td className="num right">{percent(Math.abs(worst))}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
        <p className="quiet small load-note">
          {bands
            ? "Tick: vertical force measured. Band: what springy legs would carry, within the errors of stiffness and touch-down."
            : "No loads are predicted for this stance."}
        </p>
      </section>
      {stability && (
        <section className="section small quiet">
          Largest torque: {readable(stability.torque_joint)}{" "}
          <span className="num">{percent(stability.torque_ratio)}</span>
        </section>
      )}
    </>
  );
}
