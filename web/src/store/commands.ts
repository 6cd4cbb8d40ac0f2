// Staging, arming, sending and taking back commands.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { CommandBody, CommandRecord, PlanCommandRef } from "../api/types";
import { uuidV7 } from "../lib/uuid";
import { noteCommand } from "./console";

interface RequestState {
  /** What is being asked for now, by a key of the thing asked about. */
  busy: Record<string, true>;
  /** Why the last request about it failed. */
  failures: Record<string, string>;
}

export const useRequests = create<RequestState>(() => ({ busy: {}, failures: {} }));

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
  const done = await ask(key, () => api.stage({ id, plan: ref }));
  // Staged: the next staging of the same command of the plan is a new one.
  if (done) identities.delete(key);
  return done;
}

export const HAND_KEY = "by-hand";

export function stageByHand(body: CommandBody): Promise<boolean> {
  return ask(HAND_KEY, () => api.stage({ id: uuidV7(), body }));
}

export const arm = (id: string) => ask(id, () => api.arm(id));
export const sendArmed = (id: string) => ask(id, () => api.sendCommand(id));
export const takeBack = (id: string) => ask(id, () => api.cancelCommand(id));
