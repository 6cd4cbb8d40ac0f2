// Wheels by hand: mode, brakes, steering and rolling of one, some or all; and driving along an arc.

import { useState } from "react";

import type { CommandBody, RoverTelemetry } from "../../api/types";
import { DEG, degrees, legLabel, metres } from "../../lib/format";
import { useConsole, useLive } from "../../store/console";
import { Segments } from "../../ui/Segments";
import { HandField, within } from "./HandField";
import { StageButton } from "./StageButton";

type Mode = "safe" | "ready" | "driving";

const MODES: [Mode, string, string][] = [
  ["safe", "Safe", "Brakes on; only modes, holds and stops are taken"],
  ["ready", "Ready", "Legs and body move over braked wheels"],
  ["driving", "Driving", "Wheels may be released, steered and driven"],
];

export function Wheels() {
  return (
    <>
      <ModeOfOperation />
      <WheelTable />
      <DriveArc />
    </>
  );
}

function ModeOfOperation() {
  const operation = useLive((c) => c.rover?.message.operation);
  const [wanted, setWanted] = useState<Mode | null>(null);
  const present = operation?.mode ?? "ready";
  const mode = wanted ?? present;
  const body: CommandBody = { type: "mode", mode };
  return (
    <section className="section stack" aria-label="Mode of operation">
      <h2>Mode of operation</h2>
      <Segments
        name="operating"
        label="Mode of operation"
        choices={MODES}
        value={mode}
        set={setWanted}
        testId="operating"
      />
      <div className="row between">
        <span className="quiet small" data-testid="operating-now">
          reported: {operation ? present : "not told"}
        </span>
        <StageButton
          body={mode === present ? null : body}
          step={body}
          label="Stage mode"
          testId="hand-mode"
        />
      </div>
    </section>
  );
}

type Wheel = NonNullable<RoverTelemetry["operation"]>["wheels"][string];

function WheelTable() {
  const legs = useConsole((s) => s.model?.legs);
  const wheels = useLive((c) => c.rover?.message.operation?.wheels);
  const [off, setOff] = useState<readonly string[]>([]);
  const [heading, setHeading] = useState("0");
  const [roll, setRoll] = useState("90");
  const names = (legs ?? []).map((leg) => leg.name);
  const chosen = names.filter((name) => !off.includes(name));
  const all = chosen.length === names.length;
  const some = chosen.length > 0;
  const brake = (on: boolean): CommandBody | null =>
    some ? { type: "wheel_brake", legs: all ? [] : chosen, on } : null;
  const heading_deg = within(heading, 360);
  const steer: CommandBody | null =
    some && heading_deg !== null
      ? {
          type: "wheel_steer",
          headings_rad: Object.fromEntries(chosen.map((name) => [name, heading_deg / DEG])),
        }
      : null;
  const roll_deg = within(roll, 3600);
  const one = chosen.length === 1 ? chosen[0]! : null;
  const rolling: CommandBody | null =
    one !== null && roll_deg !== null && roll_deg !== 0
      ? { type: "wheel_roll", leg: one, angle_rad: roll_deg / DEG }
      : null;
  const n_on = Object.values(wheels ?? {}).filter((wheel) => wheel.brake).length;
  if (!legs) return <p className="section quiet">The model of the rover is not here yet.</p>;
  return (
    <section className="section stack" aria-label="Wheels">
      <div className="row between">
        <h2>Wheels</h2>
        <span className="quiet small" data-testid="brakes-now">
          {wheels ? `${n_on} of ${Object.keys(wheels).length} brakes on` : "brakes not told"}
        </span>
      </div>
      <table className="wheel-table">
        <thead>
          <tr>
            <th>
              <label className="check">
                <input
                  type="checkbox"
                  data-testid="wheels-all"
                  ref={(box) => {
                    if (box) box.indeterminate = some && !all;
                  }}
                  checked={all}
                  onChange={() => setOff(all ? names : [])}
                />
                all
              </label>
            </th>
            <th>brake</th>
            <th>heading</th>
            <th>spin</th>
          </tr>
        </thead>
        <tbody className="of-rover">
          {names.map((name) => (
            <WheelRow
              key={name}
              name={name}
              wheel={wheels?.[name]}
              chosen={!off.includes(name)}
              toggle={() =>
                setOff(off.includes(name) ? off.filter((n) => n !== name) : [...off, name])
              }
            />
          ))}
        </tbody>
      </table>
      <div className="row between">
        <span className="quiet small">{whose(chosen, all)}</span>
        <span className="row command-actions">
          <StageButton body={brake(false)} label="Release" testId="hand-release" />
          <StageButton body={brake(true)} label="Brake" testId="hand-brake" />
        </span>
      </div>
      <div className="hand-pair">
        <HandField
          label="steer to (°), left of ahead"
          testId="steer-heading"
          value={heading}
          bad={heading_deg === null}
          set={setHeading}
        />
        <StageButton body={steer} label="Stage steer" testId="hand-steer" />
      </div>
      <div className="hand-pair">
        <HandField
          label="roll by (°), positive ahead"
          testId="roll-angle"
          value={roll}
          bad={roll_deg === null}
          set={setRoll}
        />
        <StageButton body={rolling} label="Stage roll" testId="hand-roll" />
      </div>
      <p className="quiet small">
        Released, steered and rolled in mode driving only. Rolled is one wheel that is off the
        ground.
      </p>
    </section>
  );
}

function whose(chosen: readonly string[], all: boolean): string {
  if (all) return "all wheels";
  if (chosen.length === 0) return "choose wheels";
  return chosen.length > 2 ? `${chosen.length} wheels` : chosen.map(legLabel).join(", ");
}

function WheelRow(props: {
  name: string;
  wheel: Wheel | undefined;
  chosen: boolean;
  toggle: () => void;
}) {
  const { name, wheel, chosen, toggle } = props;
  return (
    <tr>
      <th scope="row">
        <label className="check">
          <input type="checkbox" data-testid={`wheel-${name}`} checked={chosen} onChange={toggle} />
          {legLabel(name)}
        </label>
      </th>
      <td data-testid={`brake-${name}`}>{wheel ? (wheel.brake ? "on" : "off") : "–"}</td>
      <td className="num">{degrees(wheel?.heading_rad, 0)}</td>
      <td className="num">{wheel ? `${(wheel.spin_rad_s * DEG).toFixed(0)}°/s` : "–"}</td>
    </tr>
  );
}

function DriveArc() {
  const [distance, setDistance] = useState("1.0");
  const [turn, setTurn] = useState("0");
  const [course, setCourse] = useState("0");
  const distance_m = within(distance, 20);
  const turn_deg = within(turn, 360);
  const course_deg = within(course, 360);
  const good =
    distance_m !== null &&
    turn_deg !== null &&
    course_deg !== null &&
    (distance_m !== 0 || turn_deg !== 0);
  const body: CommandBody | null = good
    ? {
        type: "drive_arc",
        distance_m,
        turn_rad: turn_deg / DEG,
        course_rad: course_deg / DEG,
      }
    : null;
  return (
    <section className="section stack" aria-label="Drive along an arc">
      <h2>Drive along an arc</h2>
      <div className="hand-three">
        <HandField label="way (m)" testId="arc-distance" value={distance} set={setDistance} />
        <HandField label="turn (°)" testId="arc-turn" value={turn} set={setTurn} />
        <HandField label="course (°)" testId="arc-course" value={course} set={setCourse} />
      </div>
      <div className="row between">
        <span className="quiet small num">{good && radiusText(distance_m, turn_deg)}</span>
        <StageButton body={body} label="Stage drive" testId="hand-drive" />
      </div>
    </section>
  );
}

function radiusText(distance_m: number, turn_deg: number): string {
  if (turn_deg === 0) return "straight";
  if (distance_m === 0) return "on the spot";
  const radius_m = (distance_m / turn_deg) * DEG;
  return `radius ${metres(Math.abs(radius_m))}, center to the ${radius_m > 0 ? "left" : "right"}`;
}
