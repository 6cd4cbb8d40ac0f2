// Operations by hand that take no leg: mode, brakes, driving along an arc, the body, holds.

import { useState } from "react";

import type { CommandBody, Vec3 } from "../../api/types";
import { DEG, metres } from "../../lib/format";
import { useLive } from "../../store/console";
import { Segments } from "../../ui/Segments";
import { StageButton } from "./StageButton";

type Mode = "safe" | "ready" | "driving";

const MODES: [Mode, string, string][] = [
  ["safe", "Safe", "Brakes on; only modes, holds and stops are taken"],
  ["ready", "Ready", "Legs and body move over braked wheels"],
  ["driving", "Driving", "Wheels may be released, steered and driven"],
];

export function Operations() {
  return (
    <>
      <ModeAndBrakes />
      <DriveArc />
      <BodyMove />
      <section className="section row between">
        <span className="quiet small">Brakes on as soon as the stance is safe</span>
        <StageButton body={{ type: "hold" }} label="Stage hold" testId="hand-hold" />
      </section>
    </>
  );
}

function ModeAndBrakes() {
  const operation = useLive((c) => c.rover?.message.operation);
  const [wanted, setWanted] = useState<Mode | null>(null);
  const present = operation?.mode ?? "ready";
  const mode = wanted ?? present;
  const brakes = Object.values(operation?.wheels ?? {}).map((wheel) => wheel.brake);
  const n_on = brakes.filter(Boolean).length;
  return (
    <section className="section stack" aria-label="Mode and brakes">
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
          body={mode === present ? null : { type: "mode", mode }}
          label="Stage mode"
          testId="hand-mode"
        />
      </div>
      <div className="row between">
        <span className="quiet small" data-testid="brakes-now">
          {operation ? `${n_on} of ${brakes.length} brakes on` : "brakes not told"}
        </span>
        <span className="row command-actions">
          <StageButton
            body={{ type: "wheel_brake", legs: [], on: false }}
            label="Release"
            testId="hand-release"
          />
          <StageButton
            body={{ type: "wheel_brake", legs: [], on: true }}
            label="Brake"
            testId="hand-brake"
          />
        </span>
      </div>
    </section>
  );
}

/** A text as a number within bounds, or null. */
function within(text: string, most: number): number | null {
  const value = Number(text);
  return text.trim() !== "" && Number.isFinite(value) && Math.abs(value) <= most ? value : null;
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
        <Field label="way (m)" testId="arc-distance" value={distance} set={setDistance} />
        <Field label="turn (°)" testId="arc-turn" value={turn} set={setTurn} />
        <Field label="course (°)" testId="arc-course" value={course} set={setCourse} />
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

function BodyMove() {
  const [moves, setMoves] = useState(["0", "0", "0.05"]);
  const [turns, setTurns] = useState(["0", "0", "0"]);
  const by = moves.map((text) => within(text, 2));
  const turned = turns.map((text) => within(text, 60));
  const good = [...by, ...turned].every((v) => v !== null);
  const moved = good && [...by, ...turned].some((v) => v !== 0);
  const body: CommandBody | null = moved
    ? {
        type: "body_move",
        translation_m: by as Vec3,
        rotation_rad: turned.map((v) => v! / DEG) as Vec3,
      }
    : null;
  return (
    <section className="section stack" aria-label="Move the body">
      <h2>Move the body by</h2>
      <div className="hand-three">
        {["x (m)", "y (m)", "up (m)"].map((label, i) => (
          <Field
            key={label}
            label={label}
            testId={`body-${i}`}
            value={moves[i]!}
            set={(text) => setMoves(moves.with(i, text))}
          />
        ))}
        {["about x (°)", "about y (°)", "about z (°)"].map((label, i) => (
          <Field
            key={label}
            label={label}
            testId={`body-turn-${i}`}
            value={turns[i]!}
            set={(text) => setTurns(turns.with(i, text))}
          />
        ))}
      </div>
      <div className="row between">
        <span className="quiet small">in the frame of the base</span>
        <StageButton body={body} label="Stage body move" testId="hand-body" />
      </div>
    </section>
  );
}

interface FieldProps {
  label: string;
  testId: string;
  value: string;
  set: (text: string) => void;
}

function Field({ label, testId, value, set }: FieldProps) {
  return (
    <label className="field">
      {label}
      <input
        type="number"
        step="any"
        className="num"
        data-testid={testId}
        value={value}
        onChange={(event) => set(event.target.value)}
      />
    </label>
  );
}
