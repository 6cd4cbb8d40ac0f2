// What is not as it should be, worst first: the global bar shows the worst and the count.

import { carrierDown, carrierWords } from "./carrier";
import type { Channels } from "./streamState";
import type { Connection } from "./console";
import type { RoverModel } from "../api/types";
import { readable, legLabel, metres, percent } from "../lib/format";

export const STATUSES = ["normal", "standby", "caution", "serious", "critical"] as const;
export type Status = "off" | (typeof STATUSES)[number];

export interface Cause {
  status: Status;
  text: string;
}

export interface Situation {
  connection: Connection;
  model: RoverModel | null;
  channels: Channels;
  stale: boolean;
}

export function causesOf({ connection, model, channels, stale }: Situation): Cause[] {
  const causes: Cause[] = [];
  const add = (status: Status, text: string) => causes.push({ status, text });
  if (connection === "lost") add("critical", "No connection to the ground server");
  const down = carrierDown(channels);
  if (down && connection === "open") {
    add("critical", `${carrierWords(down)}${down.why ? `: ${down.why}` : ""}`);
  }
  const rover = channels.rover?.message;
  if (rover?.mode === "fault") add("critical", `Rover fault: ${rover.fault ?? "not told"}`);
  if (rover?.mode === "stopped") add("serious", "The rover is stopped by an E-stop");
  const log = channels.link?.message.flight_log;
  if (log?.error) add("critical", `Flight log: ${log.error}`);
  else if (log && log.dropped > 0)
    add("standby", `${log.dropped} messages of this session are not in the flight log`);
  if (stale && connection === "open") add("caution", "Telemetry is old");
  for (const c of channels.commands) {
    if (c.state === "overdue") add("serious", `“${readable(c.title)}” is overdue, outcome unknown`);
  }
  const stability = channels.stability?.message;
  if (stability && model) {
    const margin = stability.regular?.margin_m;
    if (margin === undefined) add("serious", "No support polygon: fewer than three feet stand");
    else if (margin < 0) add("critical", "The center of mass is outside the support polygon");
    else if (margin < model.margin_m) {
      add("serious", `Margin ${metres(margin)} is below ${metres(model.margin_m)}`);
    }
    const settled = stability.settlement_margin_m;
    if (settled != null && settled < 0) {
      const leg = stability.settlement_leg ? legLabel(stability.settlement_leg) : "a foot";
      add("caution", `A settlement of ${leg} would tip the rover`);
    }
    const slip = stability.forces?.slip_margin;
    if (stability.forces && (slip == null || slip < 0)) {
      add("critical", "Friction as taken does not hold the stance");
    }
    if (stability.torque_ratio > 1)
      add("critical", torque(stability.torque_joint, stability.torque_ratio));
    else if (stability.torque_ratio > 0.8) {
      add("caution", torque(stability.torque_joint, stability.torque_ratio));
    }
  }
  if (channels.missed > 0) add("standby", `${channels.missed} messages were skipped here`);
  return causes.sort((a, b) => rank(b.status) - rank(a.status));
}

function torque(joint: string, ratio: number): string {
  return `Torque of ${readable(joint)} is ${percent(ratio)} of its limit`;
}

function rank(status: Status): number {
  return STATUSES.indexOf(status as (typeof STATUSES)[number]);
}
