// Turning one wheel about the point where it touches the ground.

import { useState } from "react";

import type { CommandBody, LegModel } from "../../api/types";
import { DEG, legLabel } from "../../lib/format";
import { aboutContact, axisOf, headingOf, type TurnAxis } from "../../lib/turn";
import { useLive } from "../../store/console";
import { wheelOf } from "../../store/kinematics";
import { Segments } from "../../ui/Segments";
import { HandField, within } from "./HandField";
import { StageButton } from "./StageButton";

const AXES: [TurnAxis, string, string][] = [
  ["up", "On the spot", "About the vertical"],
  ["heading", "Lean", "About where the wheel heads"],
  ["axle", "Pitch", "About the axle: the fork pitches"],
];

/** Beyond this the straight way of the center is too far from the arc about the contact (°). */
const MOST_DEG = 30;

export function TurnWheel({ leg }: { leg: LegModel }) {
  const [axis, setAxis] = useState<TurnAxis>("up");
  const [angle, setAngle] = useState("10");
  const telemetry = useLive((c) => c.rover?.message);
  const contact = telemetry?.contact_points_m[leg.name];
  const center = telemetry && wheelOf(leg.name, telemetry.state);
  const heading = telemetry?.operation?.wheels[leg.name]?.heading_rad;
  const angle_deg = within(angle, MOST_DEG);
  // A wheel that heads nowhere is turned about the vertical alone.
  const known = axis === "up" || heading != null;
  let body: CommandBody | null = null;
  if (contact && center && known && angle_deg !== null && angle_deg !== 0) {
    const base = headingOf(telemetry.state.base.orientation_xyzw);
    const about = axisOf(axis, base + (heading ?? 0));
    body = {
      type: "wheel_move",
      leg: leg.name,
      frame: "offset",
      ...aboutContact(center, contact, about, angle_deg / DEG),
    };
  }
  return (
    <section className="section stack" aria-label="Turn about the contact">
      <h2>Turn the wheel of {legLabel(leg.name)} about its contact</h2>
      <Segments
        name="turn-axis"
        label="Axis"
        choices={AXES}
        value={axis}
        set={setAxis}
        testId="turn-axis"
      />
      <div className="hand-pair">
        <HandField
          label={`by (°), at most ${MOST_DEG}`}
          testId="turn-angle"
          value={angle}
          bad={angle_deg === null}
          set={setAngle}
        />
        <StageButton body={body} label="Stage turn" testId="hand-turn" />
      </div>
      {!known && <p className="quiet small">Telemetry does not tell where this wheel heads.</p>}
    </section>
  );
}
