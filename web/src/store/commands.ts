// Staging, arming, sending and taking back commands.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { CommandBody, CommandRecord, PlanCommandRef, StageRequest } from "../api/types";
import { uuidV7 } from "../lib/uuid";
import { useConditions } from "./conditions";
import { noteCommand } from "./console";

interface RequestState {
  /** What is being asked for now, by a key of the thing asked about. */
  busy: Record<string, true>;
  /** Why the last request about it failed. */
  failures: Record<string, string>;
  /** Ended commands that are no longer shown beside the open ones. */
  hidden: Record<string, true>;
}

export const useRequests = create<RequestState>(() => ({ busy: {}, failures: {}, hidden: {} }));

/** Identities of commands whose staging was asked for, so that a repeat stages nothing twice. */
const identities = new Map<string, string>();

function without<T>(record: Record<string, T>, key: string): Record<string, T> {
  return Object.fromEntries(Object.entries(record).filter(([k]) => k !== key));
}

async function ask(key: string, work: () => Promise<CommandRecord | undefined>): Promise<boolean> {
  if (useRequests.getState().busy[key]) return false;
  useRequests.setState((s) => ({
    busy: { ...s.busy, [key]: true },
    failures: without(s.failures, key),
  }));
  try {
    const record = await work();
    if (record) noteCommand(record);
    return true;
  } catch (error) {
    useRequests.setState((s) => ({ failures: { ...s.failures, [key]: sentenceOf(error) } }));
    return false;
  } finally {
    useRequests.setState((s) => ({ busy: without(s.busy, key) }));
  }
}

/** One command of a plan by a short name: `2`, on the way back `back-2`. */
export const commandName = ({ index, retreat }: PlanCommandRef) =>
  `${retreat ? "back-" : ""}${index}`;

export const planKey = (ref: PlanCommandRef) => `${ref.plan_id}#${commandName(ref)}`;

export async function stagePlanned(ref: PlanCommandRef): Promise<boolean> {
  const key = planKey(ref);
  const id = identities.get(key) ?? uuidV7();
  identities.set(key, id);
  const preconditions = useConditions.getState().plan;
  const done = await ask(key, () => api.stage({ id, plan: ref, preconditions }));
  // Staged: the next staging of the same command of the plan is a new one.
  if (done) identities.delete(key);
  return done;
}

export const HAND_KEY = "by-hand";

export function stageByHand(body: CommandBody): Promise<boolean> {
  // What stops is to be taken whatever telemetry shows.
  const stops = body.type === "stop" || body.type === "hold" || body.type === "cancel_rest";
  const preconditions = stops ? [] : useConditions.getState().hand;
  return ask(HAND_KEY, () => api.stage({ id: uuidV7(), body, preconditions }));
}

/** Stages anything; why it was refused, or null. */
export async function stageRequest(request: StageRequest): Promise<string | null> {
  try {
    noteCommand(await api.stage(request));
    return null;
  } catch (error) {
    return sentenceOf(error);
  }
}

/** The second person's word on what was looked at. */
export const approve = (command: CommandRecord) =>
  ask(command.id, () => api.approveCommand(command.id, command.approval?.content_hash ?? ""));

/** The operator's word on a command whose outcome is unknown. */
export const resolve = (id: string, done: boolean, why: string) =>
  ask(id, () => api.resolveCommand(id, done, why));

export function hideCommand(id: string): void {
  useRequests.setState((s) => ({ hidden: { ...s.hidden, [id]: true } }));
}

export const arm = (id: string) => ask(id, () => api.arm(id));
export const sendArmed = (id: string) => ask(id, () => api.sendCommand(id));
export const takeBack = (id: string) => ask(id, () => api.cancelCommand(id));
