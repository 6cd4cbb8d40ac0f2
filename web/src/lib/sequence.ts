// Sequences: their steps in words, and how far each has come by what the rover has said.

import type { CommandBody, CommandRecord } from "../api/types";
import { DEG, legLabel, metres, signless } from "./format";

const degrees = (rad: number, decimals = 0) => `${signless(rad * DEG, decimals)}°`;

/** A command by hand in a few words. */
export function bodyWords(body: CommandBody): string {
  switch (body.type) {
    case "joint_path":
      return `Joints of ${legLabel(body.leg)}`;
    case "body_path":
      return "Shift the body";
    case "wheel_line":
      return `Wheel of ${legLabel(body.leg)} straight`;
    case "joint_move":
      return `Move ${Object.keys(body.joints_rad).length} joints`;
    case "wheel_move":
      return body.rotation_rad?.some((v) => v !== 0)
        ? `Turn the wheel of ${legLabel(body.leg)}`
        : `Move the wheel of ${legLabel(body.leg)}`;
    case "body_move":
      return "Move the body";
    case "wheel_brake": {
      const of = body.legs?.length ? body.legs.map(legLabel).join(", ") : "all wheels";
      return `${body.on ? "Brake" : "Release"} ${of}`;
    }
    case "wheel_roll":
      return `Roll the wheel of ${legLabel(body.leg)} by ${degrees(body.angle_rad)}`;
    case "wheel_steer": {
      const legs = Object.entries(body.headings_rad);
      const [first] = legs;
      if (legs.length === 1 && first) return `Steer ${legLabel(first[0])} to ${degrees(first[1])}`;
      return `Steer ${legs.length} wheels`;
    }
    case "drive_arc":
      return `Drive ${metres(body.distance_m)}${body.turn_rad ? `, turn ${degrees(body.turn_rad)}` : ""}`;
    case "hold":
      return "Hold";
    case "mode":
      return `Mode ${body.mode}`;
    case "sequence":
      return `Sequence of ${body.steps.length} steps`;
    case "cancel_rest":
      return "Cancel the rest";
    case "stop":
      return "Stop";
    case "image":
      return "Take images";
  }
}

/** Commands that no sequence takes as a step. */
const NO_STEPS = new Set<CommandBody["type"]>(["sequence", "stop", "cancel_rest", "image"]);

export const mayBeStep = (body: CommandBody) => !NO_STEPS.has(body.type);

export type StepState = "waits" | "executing" | "done" | "failed" | "skipped" | "unknown";

export interface StepProgress {
  state: StepState;
  /** Why it failed or was skipped. */
  why: string | null;
  /** Share done as last reported; null unless executing. */
  share: number | null;
}

/** `step 2 of 3: why; step 3 was not begun` as the rover says it. */
const FAILED_AT = /^step (\d+) of (\d+): (.*?)(?:; steps? [\d to]+ (?:was|were) not begun)?$/s;

/** How far each of `n` steps has come, by the record of the sequence. */
export function stepsOf(record: CommandRecord, n: number): StepProgress[] {
  const all = (state: StepState, why: string | null = null) =>
    Array.from({ length: n }, (): StepProgress => ({ state, why, share: null }));
  const at = record.step ? Math.min(n, Math.max(1, record.step[0]!)) - 1 : 0;
  switch (record.state) {
    case "done":
      return all("done");
    case "executing": {
      // A sequence counts each step alike.
      const share = Math.min(1, Math.max(0, record.progress * n - at));
      return all("waits").map((step, i) => {
        if (i < at) return { ...step, state: "done" };
        return i === at ? { ...step, state: "executing", share } : step;
      });
    }
    case "failed":
    case "aborted":
      return ended(record, all, at);
    case "overdue":
      return all("unknown", "no word on this step").map((step, i) =>
        record.step && i < at ? { state: "done", why: null, share: null } : step,
      );
    case "cancelled":
    case "expired":
      return all("skipped", record.why ?? "the sequence was never sent");
    default:
      return all("waits");
  }
}

function ended(
  record: CommandRecord,
  all: (state: StepState) => StepProgress[],
  reported: number,
): StepProgress[] {
  const told = FAILED_AT.exec(record.why ?? "");
  // Without the rover's word on the step, and without one under way, it was refused as a whole.
  if (!told && !record.step) {
    return all("skipped").map((step, i) =>
      i === 0
        ? { state: "failed", why: record.why ?? record.state, share: null }
        : { ...step, why: "the sequence did not begin" },
    );
  }
  const failed = told ? Number(told[1]) - 1 : reported;
  return all("skipped").map((step, i) => {
    if (i < failed) return { state: "done", why: null, share: null };
    if (i === failed) return { state: "failed", why: told?.[3] ?? record.why ?? null, share: null };
    return {
      ...step,
      why: `step ${failed + 1} ${record.state === "aborted" ? "was ended" : "failed"}`,
    };
  });
}

/** A list with one item moved to another place. */
export function moved<T>(items: readonly T[], from: number, to: number): T[] {
  if (from === to || from < 0 || to < 0 || from >= items.length || to >= items.length) {
    return [...items];
  }
  const rest = items.filter((_, i) => i !== from);
  return [...rest.slice(0, to), items[from]!, ...rest.slice(to)];
}
