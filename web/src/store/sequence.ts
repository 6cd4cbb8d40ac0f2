// The sequence being put together in this console. Nothing of it is anywhere else until it is staged whole.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { CommandBody, DryRun, Precondition, StageRequest } from "../api/types";
import { bodyWords, moved } from "../lib/sequence";
import { uuidV7 } from "../lib/uuid";
import { stageRequest } from "./commands";

export interface DraftStep {
  /** Unique in the draft. */
  key: number;
  title: string;
  body: CommandBody;
  preconditions: Precondition[];
  /** The map that a planned command was checked on; null for one by hand. */
  plannedOn: string | null;
}

interface SequenceState {
  steps: DraftStep[];
  /** What the sequence as a whole waits for. */
  preconditions: Precondition[];
  dryRun: DryRun | null;
  busy: boolean;
  failure: string | null;
  /** The sequence that was staged last from here. */
  staged: string | null;
}

const EMPTY: SequenceState = {
  steps: [],
  preconditions: [],
  dryRun: null,
  busy: false,
  failure: null,
  staged: null,
};

export const useSequence = create<SequenceState>(() => EMPTY);

export const STEPS_MAX = 100;
let nextKey = 1;

/** A change of the draft makes what a dry run said of it old. */
function change(next: (state: SequenceState) => Partial<SequenceState>): void {
  useSequence.setState((state) => ({ ...next(state), dryRun: null, failure: null }));
}

export function addSteps(
  bodies: { body: CommandBody; title?: string }[],
  plannedOn: string | null = null,
): void {
  change(({ steps }) => ({
    steps: [
      ...steps,
      ...bodies.map(({ body, title }) => ({
        key: nextKey++,
        title: title ?? bodyWords(body),
        body,
        preconditions: [],
        plannedOn,
      })),
    ].slice(0, STEPS_MAX),
  }));
}

export function moveStep(from: number, to: number): void {
  change(({ steps }) => ({ steps: moved(steps, from, to) }));
}

export function removeStep(key: number): void {
  change(({ steps }) => ({ steps: steps.filter((step) => step.key !== key) }));
}

export function clearSequence(): void {
  change(() => ({ steps: [], preconditions: [] }));
}

/** What a step, or with null the sequence, waits for. */
export function setPreconditions(key: number | null, preconditions: Precondition[]): void {
  change(({ steps }) =>
    key === null
      ? { preconditions }
      : { steps: steps.map((s) => (s.key === key ? { ...s, preconditions } : s)) },
  );
}

function requestOf({ steps, preconditions }: SequenceState): StageRequest {
  return {
    body: {
      type: "sequence",
      steps: steps.map(({ body, preconditions: waits }) => ({ body, preconditions: waits })),
    },
    preconditions,
  };
}

export async function dryRunSequence(): Promise<void> {
  const before = useSequence.getState();
  useSequence.setState({ busy: true, failure: null });
  try {
    const dryRun = await api.checkCommand(requestOf(before));
    // Told of what was asked: a draft that has changed meanwhile is another.
    const same = useSequence.getState().steps === before.steps;
    useSequence.setState({ dryRun: same ? dryRun : null });
  } catch (error) {
    useSequence.setState({ failure: sentenceOf(error), dryRun: null });
  } finally {
    useSequence.setState({ busy: false });
  }
}

/** Stages the whole of it as one command; the draft is then empty. */
export async function stageSequence(): Promise<void> {
  const draft = useSequence.getState();
  if (draft.busy) return;
  useSequence.setState({ busy: true, failure: null });
  const id = uuidV7();
  const failure = await stageRequest({ id, ...requestOf(draft) });
  if (failure === null) useSequence.setState({ ...EMPTY, staged: id });
  else useSequence.setState({ busy: false, failure });
}
