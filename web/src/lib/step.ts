// The story of one step, from pick to done: where it is, and what the console waits for.

import type {
  CommandRecord,
  JobReport,
  PlanAnswer,
  PlanCommandRef,
  RoverState,
} from "../api/types";
import { awaitsApproval } from "./approval";
import { commandClock, isUnderWay } from "./commandClock";
import { legLabel } from "./format";
import { endOfCommand, isOver, type PlanProgress } from "./planProgress";
import { inTheWayOf } from "./planWords";
import { type PlanPose, poseAt } from "./pose";
import { parseOptional } from "./time";

export const STAGES = ["pick", "plan", "check", "arm", "send", "executing", "done"] as const;
export type Stage = (typeof STAGES)[number];

export interface StepInputs {
  leg: string | null;
  picked: boolean;
  job: JobReport | null;
  plan: PlanAnswer | null;
  /** How far the plan has come; null without one. */
  progress: PlanProgress | null;
  /** A command by hand that is open or under way; it comes before the plan. */
  byHand: CommandRecord | null;
  now_ms: number;
}

export interface Step {
  stage: Stage;
  /** True where the operator must act, false where the console waits. */
  yours: boolean;
  /** Something went wrong at this stage. */
  trouble: boolean;
  sentence: string;
  /** Title of the command the step stands at. */
  command: string | null;
  /** Share of the present wait, 0 to 1, where one runs. */
  share: number | null;
}

function step(stage: Stage, sentence: string, more: Partial<Step> = {}): Step {
  return { stage, sentence, yours: true, trouble: false, command: null, share: null, ...more };
}

export function stepOf(inputs: StepInputs): Step {
  const { leg, job, plan, byHand } = inputs;
  if (byHand) return stepOfCommand(byHand, byHand.title, "", inputs.now_ms);
  if (job && (job.state === "queued" || job.state === "running")) {
    const sentence = `Planning: ${job.doing || "waiting for a worker"}.`;
    return step("plan", sentence, { yours: false, share: job.progress });
  }
  if (job?.state === "failed") {
    const sentence = job.error?.message ?? "The planner failed.";
    return step("plan", sentence, { trouble: true });
  }
  if (plan && inputs.progress) return stepOfPlan(plan, inputs.progress, inputs.now_ms);
  if (leg === null) return step("pick", "Choose a leg: click a wheel, or press 1 to 6.");
  if (!inputs.picked) {
    return step("pick", `Pick a footfall for ${legLabel(leg)}: click the ground.`);
  }
  return step("plan", `Plan a step of ${legLabel(leg)} to the picked place: press Enter.`);
}

function stepOfPlan(plan: PlanAnswer, progress: PlanProgress, now_ms: number): Step {
  if (plan.outcome !== "found") {
    const why = plan.constraint ? `${inTheWayOf(plan)}. Pick another place.` : plan.reason;
    return step("check", why ?? "No path was found. Pick another place.", {
      trouble: true,
    });
  }
  if (progress.turned) return stepBack(plan, progress, now_ms);
  const at = progress.done;
  const command = plan.commands[at];
  if (!command) return step("done", doneSentence(plan));
  const record = progress.forward[at];
  if (!record) return unstaged(plan, at, command.title);
  return stepOfCommand(record, command.title, ` (${at + 1} of ${plan.commands.length})`, now_ms);
}

function doneSentence({ leg, posture }: PlanAnswer): string {
  if (!posture) return `The step of ${legLabel(leg)} is done. Pick the next.`;
  return `The posture is taken: plan the step of ${legLabel(posture.leg)}.`;
}

/** Where a step stands that is being backed out. */
function stepBack(plan: PlanAnswer, progress: PlanProgress, now_ms: number): Step {
  if (isOver(progress)) {
    const what = plan.posture ? "posture" : `step of ${legLabel(plan.leg)}`;
    return step("done", `The ${what} is backed out. Pick the next step.`);
  }
  const at = plan.commands.length - progress.done;
  const title = plan.retreat[at]?.title ?? "";
  const record = progress.back[at];
  if (record) return stepOfCommand(record, title, ", on the way back,", now_ms);
  return step("arm", `Next on the way back is “${title}”: stage and arm it.`, { command: title });
}

/** Where one command stands; `of` says which of how many it is. */
function stepOfCommand(record: CommandRecord, title: string, of: string, now_ms: number): Step {
  const clock = commandClock(record, now_ms);
  const more = { command: title, share: clock.share };
  switch (record.state) {
    case "staged": {
      const awaits = awaitsApproval(record, now_ms);
      if (awaits) {
        const waits = { ...more, yours: false };
        return step("arm", `“${title}”${of} is staged. ${awaits}`, waits);
      }
      return step("arm", `“${title}”${of} is staged: arm it.`, more);
    }
    case "armed":
      if (clock.armed_s === 0) {
        return step("arm", `The arming of “${title}” has lapsed: arm it again.`, more);
      }
      return step("send", `“${title}”${of} is armed: send it or take it back.`, more);
    case "sent":
    case "received":
      return step("send", `“${title}”${of} is on its way: ${clock.waits ?? "waiting for word"}.`, {
        ...more,
        yours: false,
      });
    case "executing":
      return step("executing", `The rover executes “${title}”${of}: ${clock.waits}.`, {
        ...more,
        yours: false,
      });
    case "overdue":
      return step("send", `“${title}”${of} is overdue: ${clock.waits}.`, {
        ...more,
        trouble: true,
      });
    case "done":
      return step("done", `“${title}” is done.`, { command: title });
    default:
      return step("arm", `“${title}”${of} ${record.state}${record.why ? `: ${record.why}` : ""}.`, {
        ...more,
        trouble: true,
      });
  }
}

function unstaged(plan: PlanAnswer, at: number, title: string): Step {
  const failed = plan.findings.filter((f) => !f.ok).length;
  if (at === 0) {
    const assumed = plan.findings.filter((f) => f.assumed).length;
    const held = assumed === 0 ? "all checks hold" : `all checks hold, ${assumed} on an assumption`;
    const checks = failed === 0 ? held : `${failed} checks do not hold`;
    return step(
      "check",
      `The plan is ready, ${checks}: look at the preview, then stage “${title}”.`,
      {
        command: title,
        trouble: failed > 0,
      },
    );
  }
  return step("arm", `Next is “${title}”: stage and arm it.`, { command: title });
}

/**
 * What a command's motion will have done by `now_ms`: dead reckoning; null where nothing moves. The base of a body shift is known from `plan` alone: that of
 * the command, or nothing is predicted.
 */
export function predictedPose(
  command: CommandRecord,
  now_ms: number,
  plan: PlanAnswer | null = null,
  reported: RoverState | null = null,
): PlanPose | null {
  const { body, state } = command;
  if (!isUnderWay(state) || state === "overdue") return null;
  const arrives = parseOptional(command.arrives);
  if (arrives === null || now_ms < arrives) return null;
  const t = (now_ms - arrives) / 1000;
  if (body.type === "joint_path") {
    return { leg: body.leg, joints_rad: jointsAt(body.knots, t), stance: null };
  }
  if (body.type !== "body_path" || !plan || plan.id !== command.plan?.plan_id) return null;
  return shiftAt(plan, t, command.plan, reported);
}

/** A plan's shift `t` seconds after its beginning, or on the way back. */
function shiftAt(
  plan: PlanAnswer,
  t: number,
  { index, retreat }: PlanCommandRef,
  reported: RoverState | null,
): PlanPose | null {
  // The last command is undone first.
  const of = retreat ? plan.commands.length - 1 - index : index;
  if (plan.commands[of] === undefined || !plan.waypoints.some((w) => w.stance)) return null;
  const [from_s, to_s] = [endOfCommand(plan, of - 1), endOfCommand(plan, of)];
  const passed = Math.min(t, to_s - from_s);
  const at = retreat ? to_s - passed : from_s + passed;
  return poseAt(plan.leg, plan.waypoints, at, reported);
}

/** Joint-linear between knots, held at both ends. */
export function jointsAt(knots: { joints_rad: number[]; time_s: number }[], t: number): number[] {
  const first = knots[0];
  if (!first) return [];
  if (t <= first.time_s) return first.joints_rad;
  for (let i = 1; i < knots.length; i++) {
    const [a, b] = [knots[i - 1]!, knots[i]!];
    if (t > b.time_s) continue;
    const span = b.time_s - a.time_s;
    const s = span > 0 ? (t - a.time_s) / span : 1;
    return a.joints_rad.map((q, k) => q + s * ((b.joints_rad[k] ?? q) - q));
  }
  return knots[knots.length - 1]!.joints_rad;
}
