// The rover in figures: contact, force and torque of each leg against the limits.

import { legLabel, newtons, percent, readable } from "../../lib/format";
import { useChannels, useConsole } from "../../store/console";
import { LimitBar } from "../../ui/LimitBar";
import { StatusMark } from "../../ui/StatusMark";
import "./telemetry.css";

export function TelemetryPanel() {
  const model = useConsole((s) => s.model);
  const rover = useChannels((c) => c.rover?.message ?? null);
  const stability = useChannels((c) => c.stability?.message ?? null);
  if (!model || !rover) return <p className="section quiet">No telemetry has come yet.</p>;
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
              <th>contact</th>
              <th className="right">force</th>
              <th colSpan={2}>torque of its limit</th>
            </tr>
          </thead>
          <tbody>
            {model.legs.map((leg) => {
              const ratios = stability?.torque_ratios[leg.name] ?? [];
              const worst = ratios.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a), 0);
              const force = rover.wheel_forces_n[leg.name];
              const stands = rover.contacts[leg.name] ?? false;
              return (
                <tr key={leg.name}>
                  <th scope="row">{legLabel(leg.name)}</th>
                  <td>
                    <span className="row">
                      <StatusMark status={stands ? "normal" : "off"} />
                      {stands ? "stands" : "lifted"}
                    </span>
                  </td>
                  <td className="num right">{force ? newtons(Math.hypot(...force)) : "–"}</td>
                  <td>
                    <LimitBar ratio={worst} label={`Largest torque of ${legLabel(leg.name)}`} />
                  </td>
                  <td className="num right">{percent(Math.abs(worst))}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
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
