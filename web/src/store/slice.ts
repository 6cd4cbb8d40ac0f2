// The energy slice of the stance that is shown along a heading, while it is looked at.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { EnergySlice } from "../api/types";
import { Latest } from "../lib/latest";
import { yawOf } from "../lib/slice";
import { useConsole } from "./console";
import { energyQuestion } from "./energy";
import { shown } from "./streamState";

export interface SliceState {
  /** Direction of travel from the rover's forward, counter-clockwise (rad). */
  heading_rad: number;
  slice: EnergySlice | null;
  state: "none" | "loading" | "ready" | "failed";
  failure: string | null;
}

export const useSlice = create<SliceState>(() => ({
  heading_rad: 0,
  slice: null,
  state: "none",
  failure: null,
}));

type Question = NonNullable<ReturnType<typeof energyQuestion>> & { world_rad: number };

const set = useSlice.setState;
let asked: string | null = null;

const latest = new Latest<Question, EnergySlice>({
  ask: async ({ contacts, com_m, mass_kg, gravity_m_s2, world_rad }, signal) => {
    const of = { com_m, mass_kg, gravity_m_s2, energy_heading_rad: world_rad };
    const feet = contacts.map((position_m) => ({ position_m }));
    const answer = await api.stability({ cases: [{ ...of, contacts: feet }] }, signal);
    const slice = answer.cases[0]?.energy_slice;
    if (!slice) throw new Error("There is no energy margin: too few feet stand.");
    return slice;
  },
  answered: (_, slice) => set({ slice, state: "ready", failure: null }),
  failed: (_, error) => {
    asked = null;
    set({ slice: null, state: "failed", failure: sentenceOf(error) });
  },
  late: () => {},
  interval_ms: 120,
  late_ms: 2000,
  pause_ms: 3000,
});

function update(): void {
  const { stream, model, connection } = useConsole.getState();
  const channels = shown(stream);
  const question = model && energyQuestion(channels, model);
  if (!question || !channels.rover) {
    asked = null;
    latest.stop();
    if (useSlice.getState().state !== "none") set({ slice: null, state: "none", failure: null });
    return;
  }
  const { heading_rad } = useSlice.getState();
  const key = `${question.key}|${heading_rad.toFixed(4)}`;
  if (key === asked || connection !== "open") return;
  asked = key;
  if (useSlice.getState().state === "none") set({ state: "loading" });
  const world_rad = heading_rad + yawOf(channels.rover.message.state.base.orientation_xyzw);
  latest.want({ ...question, world_rad });
}

/** Keeps the slice up to date until the returned function is called. */
export function startSlice(): () => void {
  const stops = [
    useConsole.subscribe(update),
    useSlice.subscribe((now, before) => now.heading_rad !== before.heading_rad && update()),
  ];
  update();
  return () => {
    for (const stop of stops) stop();
    asked = null;
    latest.stop();
  };
}
