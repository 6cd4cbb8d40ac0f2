// Moving the chassis over the wheels that stand.

import { useState } from "react";

import type { CommandBody, Vec3 } from "../../api/types";
import { DEG } from "../../lib/format";
import { HandField, within } from "./HandField";
import { StageButton } from "./StageButton";

export function BodyMove() {
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
          <HandField
            key={label}
            label={label}
            testId={`body-${i}`}
            value={moves[i]!}
            bad={by[i] === null}
            set={(text) => setMoves(moves.with(i, text))}
          />
        ))}
        {["about x (°)", "about y (°)", "about z (°)"].map((label, i) => (
          <HandField
            key={label}
            label={label}
            testId={`body-turn-${i}`}
            value={turns[i]!}
            bad={turned[i] === null}
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
