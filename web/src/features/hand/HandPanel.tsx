// Commands by hand: for the chosen leg, for wheels, for the body, and sequences of them.

import { useState } from "react";

import type { CommandBody, LegModel, Vec3 } from "../../api/types";
import { DEG, legLabel, signless } from "../../lib/format";
import { HAND_KEY, useRequests } from "../../store/commands";
import { useConsole, useLive } from "../../store/console";
import { wheelOf } from "../../store/kinematics";
import { useSelection } from "../../store/selection";
import { type HandPart, useView } from "../../store/view";
import { Segments } from "../../ui/Segments";
import { NextConditions } from "../conditions/NextConditions";
import { SequenceBuilder } from "../sequence/SequenceBuilder";
import { BodyMove } from "./BodyMove";
import { HandCommands } from "./HandCommands";
import { StageButton } from "./StageButton";
import { TurnWheel } from "./TurnWheel";
import { Wheels } from "./Wheels";
import "./hand.css";

const PARTS: [HandPart, string, string][] = [
  ["leg", "Leg", "One leg: its wheel, its joints"],
  ["wheels", "Wheels", "Mode, brakes, steering, rolling, driving"],
  ["body", "Body", "The chassis over its feet"],
  ["sequence", "Sequence", "Commands one after another, sent as one"],
];

export function HandPanel() {
  const part = useView((s) => s.handPart);
  const failure = useRequests((s) => s.failures[HAND_KEY]);
  return (
    <>
      <div className="section">
        <Segments
          name="hand-part"
          label="What is commanded"
          choices={PARTS}
          value={part}
          set={(next) => useView.setState({ handPart: next })}
          testId="hand-part"
          inline
        />
      </div>
      {part === "leg" && <OneLeg />}
      {part === "wheels" && <Wheels />}
      {part === "body" && <BodyMove />}
      {part === "sequence" && <SequenceBuilder />}
      {part !== "sequence" && (
        <section className="section">
          <NextConditions of="hand" />
        </section>
      )}
      <section className="section stack" aria-label="Stop and hold">
        <div className="row between">
          <span className="quiet small">Stop what is under way</span>
          <StageButton body={{ type: "stop" }} label="Stage stop" testId="hand-stop" />
        </div>
        <div className="row between">
          <span className="quiet small">Brakes on once it is safe</span>
          <StageButton body={{ type: "hold" }} label="Stage hold" testId="hand-hold" />
        </div>
      </section>
      {failure && (
        <p className="section trouble" role="alert">
          {failure}
        </p>
      )}
      <HandCommands />
    </>
  );
}

function OneLeg() {
  const chosen = useSelection((s) => s.leg);
  const leg = useConsole((s) => s.model?.legs.find((l) => l.name === chosen));
  const speed = useConsole((s) => s.model?.joint_speed_rad_s ?? 0.1);
  const joints = useLive((c) => (chosen ? c.rover?.message.state.joints_rad[chosen] : undefined));
  if (!leg || !joints) {
    return <p className="section quiet">Choose a leg to move it by hand: 1 to 6.</p>;
  }
  return (
    <>
      <WheelLine key={`line-${leg.name}`} leg={leg} />
      <TurnWheel key={`turn-${leg.name}`} leg={leg} />
      <Joints key={leg.name} leg={leg} now_rad={joints} speed={speed} />
    </>
  );
}

function WheelLine({ leg }: { leg: LegModel }) {
  const [moves, setMoves] = useState(["0", "0", "0.20"]);
  const state = useLive((c) => c.rover?.message.state);
  const deltas = moves.map(Number);
  const good = deltas.every((d, i) => moves[i] !== "" && Number.isFinite(d) && Math.abs(d) <= 3);
  const from = state && wheelOf(leg.name, state);
  const target = good && from ? (from.map((v, i) => v + deltas[i]!) as Vec3) : null;
  const isMove = target !== null && deltas.some((d) => d !== 0);
  const body: CommandBody | null = isMove
    ? { type: "wheel_line", leg: leg.name, position_m: target }
    : null;
  // A step goes so far from where the one before has left the wheel.
  const step: CommandBody | null = isMove
    ? { type: "wheel_move", leg: leg.name, frame: "offset", position_m: deltas as Vec3 }
    : null;
  return (
    <section className="section stack" aria-label="Wheel along a line">
      <h2>Move the wheel of {legLabel(leg.name)} by</h2>
      <div className="hand-three">
        {["x", "y", "up"].map((name, i) => (
          <label key={name} className="field">
            {name} (m)
            <input
              type="number"
              step={0.05}
              className="num"
              data-testid={`line-${name}`}
              value={moves[i]}
              onChange={(event) => setMoves(moves.with(i, event.target.value))}
            />
          </label>
        ))}
      </div>
      <div className="row between">
        <span className="quiet small num hand-to">
          {target && `to ${target.map((v) => signless(v, 2)).join(", ")} m`}
        </span>
        <StageButton body={body} step={step} label="Stage line" testId="hand-line" />
      </div>
    </section>
  );
}

const SHORT = ["hip yaw", "hip pitch", "knee pitch", "knee roll", "ankle pitch", "ankle roll"];

function Joints({ leg, now_rad, speed }: { leg: LegModel; now_rad: number[]; speed: number }) {
  const [draft, setDraft] = useState<Record<number, string>>({});
  const target = now_rad.map((q, i) => (draft[i] === undefined ? q : Number(draft[i]) / DEG));
  const within = target.map((q, i) => {
    const [low, high] = leg.limits_rad[i] ?? [-Infinity, Infinity];
    return draft[i] !== "" && Number.isFinite(q) && q >= low - 1e-9 && q <= high + 1e-9;
  });
  const far = Math.max(...target.map((q, i) => Math.abs(q - now_rad[i]!)));
  const good = within.every(Boolean) && far > 1e-4;
  const knots = [
    { joints_rad: now_rad, time_s: 0 },
    { joints_rad: target, time_s: far / speed },
  ];
  const body: CommandBody | null = good ? { type: "joint_path", leg: leg.name, knots } : null;
  // A step moves the joints from where the one before has left them.
  const goals = Object.fromEntries(leg.joints.map((joint, i) => [joint, target[i]!]));
  const step: CommandBody | null = good ? { type: "joint_move", joints_rad: goals } : null;
  return (
    <section className="section stack" aria-label="Joint angles">
      <h2>Joint angles of {legLabel(leg.name)}</h2>
      <div className="hand-three">
        {now_rad.map((q, i) => {
          const [low, high] = leg.limits_rad[i] ?? [0, 0];
          return (
            <label
              key={i}
              className="field"
              title={`${(low * DEG).toFixed(0)}° to ${(high * DEG).toFixed(0)}°`}
            >
              {SHORT[i] ?? leg.joints[i]} (°)
              <input
                type="number"
                step={1}
                className="num"
                data-testid={`joint-${i}`}
                aria-invalid={!within[i]}
                value={draft[i] ?? (q * DEG).toFixed(1)}
                onChange={(event) => setDraft({ ...draft, [i]: event.target.value })}
              />
            </label>
          );
        })}
      </div>
      <div className="row between">
        <button type="button" className="button bare" onClick={() => setDraft({})}>
          As reported
        </button>
        <StageButton body={body} step={step} label="Stage joints" testId="hand-joints" />
      </div>
    </section>
  );
}
