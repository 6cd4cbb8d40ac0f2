// How far a plan has come, there and back, from the commands that the ground knows.

import type { CommandRecord, PlanAnswer } from "../api/types";
import { isUnderWay } from "./commandClock";

type Records = (CommandRecord | undefined)[];

export interface PlanProgress {
  /** The latest record of each of the plan's commands, by index. */
  forward: Records;
  /** ... and of each part of its way back. */
  back: Records;
  /** Commands that are done and not undone. */
  done: number;
  /** A part of the way back is done: the plan goes back only. */
  backingOut: boolean;
  /** A part of the way back is to be done next, or was begun. */
  turned: boolean;
  /** One of its commands is on its way or moving. */
  underWay: boolean;
}

/** The latest command staged for each of a plan's commands, or parts of its way back. */
export function ofPlan(
  commands: CommandRecord[],
  plan_id: string,
  count: number,
  retreat = false,
): Records {
  const isOf = ({ plan, state }: CommandRecord, index: number) =>
    plan?.plan_id === plan_id &&
    plan.index === index &&
    (plan.retreat ?? false) === retreat &&
    state !== "cancelled";
  return Array.from({ length: count }, (_, index) => commands.findLast((c) => isOf(c, index)));
}

type Planned = Pick<PlanAnswer, "id" | "commands" | "retreat">;

export function planProgress(
  { id, commands, retreat }: Planned,
  records: CommandRecord[],
): PlanProgress {
  const forward = ofPlan(records, id, commands.length);
  const back = ofPlan(records, id, retreat.length, true);
  const isDone = (r: CommandRecord | undefined) => r?.state === "done";
  const undone = back.filter(isDone).length;
  const open = forward.findIndex((r) => !isDone(r));
  return {
    forward,
    back,
    done: (open < 0 ? forward.length : open) - undone,
    backingOut: undone > 0,
    turned: undone > 0 || back.some((r) => r && r.state !== "expired"),
    underWay: [...forward, ...back].some((r) => r && isUnderWay(r.state)),
  };
}

/** Nothing more comes of the plan: the step is done, or backed out. */
export function isOver({ done, forward, turned, backingOut }: PlanProgress): boolean {
  return (backingOut && done === 0) || (!turned && forward.length > 0 && done === forward.length);
}

/** Has anything of the plan been staged? */
export function isBegun({ forward, back }: PlanProgress): boolean {
  return [...forward, ...back].some((r) => r !== undefined);
}

/** When a command of the plan ends (s after its start): each goes on where the one before it ended. */
export function endOfCommand({ commands }: Pick<PlanAnswer, "commands">, index: number): number {
  return commands.slice(0, index + 1).reduce((sum, c) => sum + c.duration_s, 0);
}
