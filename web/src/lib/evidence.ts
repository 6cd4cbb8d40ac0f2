// What telemetry shows of a command whose outcome is unknown. It only compares; a person decides.

import type { CommandBody, CommandRecord, LegModel, RoverTelemetry, Vec3 } from "../api/types";
import { DEG, legLabel, metres, signless } from "./format";
import { parseOptional } from "./time";

/** What the state as reported fits. */
export type Fits = "done" | "not_done" | "neither" | "not_there" | "unknown";

export interface Evidence {
  fits: Fits;
  /** In a sentence what was compared. */
  text: string;
}

/** Joints within this of a command's end count as there (rad): as near as plans are held to. */
const NEAR_RAD = 0.01;
/** ... and a wheel (m). */
const NEAR_M = 0.01;

const NOT_TOLD: Evidence = {
  fits: "unknown",
  text: "Telemetry does not tell by itself: compare scene and figures with what was commanded.",
};

export interface Shown {
  telemetry: RoverTelemetry;
  legs: LegModel[];
  /** Center of a leg's wheel as reported (m). */
  wheel: (leg: string) => Vec3 | null;
}

export function evidenceOf(body: CommandBody, shown: Shown): Evidence {
  const { telemetry } = shown;
  switch (body.type) {
    case "joint_path":
      return ofPath([[body.leg, body.knots.map((k) => k.joints_rad)]], telemetry);
    case "body_path": {
      const legs = Object.keys(body.knots[0]?.joints_rad ?? {});
      return ofPath(
        legs.map((leg) => [leg, body.knots.map((k) => k.joints_rad[leg] ?? [])]),
        telemetry,
      );
    }
    case "wheel_line": {
      const wheel = shown.wheel(body.leg);
      if (!wheel) return NOT_TOLD;
      const off = Math.hypot(...wheel.map((v, i) => v - body.position_m[i]!));
      return {
        fits: off <= NEAR_M ? "done" : "not_there",
        text: `The wheel of ${legLabel(body.leg)} is ${metres(off)} from where it was to go.`,
      };
    }
    case "joint_move":
      return ofJoints(body.joints_rad, shown);
    case "mode": {
      const mode = telemetry.operation?.mode;
      if (!mode) return NOT_TOLD;
      return {
        fits: mode === body.mode ? "done" : "not_done",
        text: `The rover reports mode ${mode}; ${body.mode} was commanded.`,
      };
    }
    case "wheel_brake": {
      const wheels = telemetry.operation?.wheels;
      if (!wheels) return NOT_TOLD;
      const legs = body.legs?.length ? body.legs : Object.keys(wheels);
      const right = legs.filter((leg) => wheels[leg]?.brake === body.on).length;
      return {
        fits: right === legs.length ? "done" : right === 0 ? "not_done" : "neither",
        text: `${right} of ${legs.length} brakes are ${body.on ? "on" : "off"}, as commanded.`,
      };
    }
    case "stop":
    case "hold":
      return {
        fits: telemetry.mode === "executing" ? "not_done" : "done",
        text: `The rover reports ${telemetry.mode}.`,
      };
    default:
      return NOT_TOLD;
  }
}

/** Paths of legs, each by its knots. */
function ofPath(legs: [string, number[][]][], telemetry: RoverTelemetry): Evidence {
  let [toEnd, toStart, long] = [0, 0, 0];
  for (const [leg, knots] of legs) {
    const now = telemetry.state.joints_rad[leg];
    const [first, last] = [knots[0], knots.at(-1)];
    if (!now || !first || !last) return NOT_TOLD;
    toEnd = Math.max(toEnd, furthest(now, last));
    toStart = Math.max(toStart, furthest(now, first));
    long = Math.max(long, furthest(first, last));
  }
  if (legs.length === 0) return NOT_TOLD;
  const who = legs.length === 1 ? capitalLeg(legs[0]![0]) : "The legs";
  const are = legs.length === 1 ? "is" : "are";
  const text = `${who} ${are} ${degrees(toEnd)} from where the command ends, ${degrees(toStart)} from where it begins.`;
  // A way that is shorter than what counts as near tells nothing.
  if (long <= NEAR_RAD) return { fits: "unknown", text };
  return { fits: toEnd <= NEAR_RAD ? "done" : toStart <= NEAR_RAD ? "not_done" : "neither", text };
}

function ofJoints(goals: Record<string, number>, { telemetry, legs }: Shown): Evidence {
  let off = 0;
  for (const [joint, goal] of Object.entries(goals)) {
    const leg = legs.find((l) => l.joints.includes(joint));
    const now = leg && telemetry.state.joints_rad[leg.name]?.[leg.joints.indexOf(joint)];
    if (now === undefined) return NOT_TOLD;
    off = Math.max(off, Math.abs(now - goal));
  }
  const text = `The joints are ${degrees(off)} from where they were to go.`;
  return { fits: off <= NEAR_RAD ? "done" : "not_there", text };
}

const furthest = (a: number[], b: number[]) =>
  Math.max(0, ...a.map((v, i) => Math.abs(v - (b[i] ?? v))));

const degrees = (rad: number) => `${signless(rad * DEG, 1)}°`;
const capitalLeg = (leg: string) => legLabel(leg).replace(/^./, (c) => c.toUpperCase());

export const FIT_WORDS: Record<Fits, string> = {
  done: "fits that it was done",
  not_done: "fits that it was not done",
  neither: "fits neither its beginning nor its end",
  not_there: "fits that it was not done, or not to its end",
  unknown: "does not tell",
};

/** The last stage that is known to be passed, in words. */
export function lastStage(command: CommandRecord): string {
  const passed = (command.verification ?? []).filter((v) => v.outcome === "ok");
  const words: Record<string, string> = {
    released: "released to the link; nobody knows whether it was transmitted",
    transmitted: "transmitted; the rover has not said that it has it",
    received: "the rover has said that it has it, not that it began",
    started: "the rover has said that it began, not how it ended",
    completed: "completed",
  };
  return words[passed.at(-1)?.stage ?? ""] ?? "nothing is verified";
}

/** Seconds of telemetry since the command would have reached the rover; null without any. */
export function heardSince(command: CommandRecord, onboard_ms: number | null): number | null {
  const arrives = parseOptional(command.arrives);
  if (arrives === null || onboard_ms === null || onboard_ms < arrives) return null;
  return (onboard_ms - arrives) / 1000;
}
