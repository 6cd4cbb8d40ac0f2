// The energy surface of the stance that is shown: asked for while it is looked at, one request at a time.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { StabilityDerived, Vec2, Vec3 } from "../api/types";
import { type EnergyGrid, mostOf, readEnergy, surfaceResolution } from "../lib/energySheet";
import { Latest } from "../lib/latest";
import { useConsole } from "./console";
import { type Channels, shown } from "./streamState";
import { useView } from "./view";

export interface Surface {
  grid: EnergyGrid;
  polygon: Vec2[];
  com_m: Vec3;
  most_m: number;
  /** At the center of mass itself. */
  margin_m: number | null;
  margin_j: number | null;
}

export interface EnergyState {
  surface: Surface | null;
  state: "none" | "loading" | "ready" | "failed";
  failure: string | null;
}

const NOTHING: EnergyState = { surface: null, state: "none", failure: null };

export const useEnergy = create<EnergyState>(() => NOTHING);

interface Question {
  key: string;
  contacts: Vec3[];
  com_m: Vec3;
  mass_kg: number;
  gravity_m_s2: number;
  polygon: Vec2[];
}

/** Nothing is asked anew before a foot or the center of mass moves by this (m). */
const MOVED_M = 0.005;

export function energyQuestion(
  { rover, stability }: Pick<Channels, "rover" | "stability">,
  model: { mass_kg: number; gravity_m_s2: number },
): Question | null {
  const polygon = stability?.message.regular?.polygon_m;
  if (!rover || !stability || !polygon) return null;
  const { contacts: stands, contact_points_m } = rover.message;
  const contacts = Object.entries(contact_points_m)
    .filter(([leg]) => stands[leg])
    .map(([, at]) => at);
  const { com_m }: StabilityDerived = stability.message;
  const round = (v: number) => Math.round(v / MOVED_M);
  const key = [com_m, ...contacts].map((p) => p.map(round).join()).join("|");
  const { mass_kg, gravity_m_s2 } = model;
  return { key, contacts, com_m, mass_kg, gravity_m_s2, polygon };
}

const set = useEnergy.setState;
let asked: string | null = null;

async function ask(question: Question, signal: AbortSignal): Promise<Surface> {
  const { contacts, com_m, mass_kg, gravity_m_s2, polygon } = question;
  const answer = await api.stability(
    {
      cases: [
        {
          contacts: contacts.map((position_m) => ({ position_m })),
          com_m,
          mass_kg,
          gravity_m_s2,
          energy_surface_m: surfaceResolution(polygon),
        },
      ],
    },
    signal,
  );
  const told = answer.cases[0];
  if (!told?.energy_surface) throw new Error("There is no energy surface: too few feet stand.");
  const grid = readEnergy(told.energy_surface);
  return {
    grid,
    polygon: told.regular?.polygon_m ?? polygon,
    com_m,
    most_m: mostOf(grid),
    margin_m: told.energy_margin_m ?? null,
    margin_j: told.energy_margin_j ?? null,
  };
}

const latest = new Latest<Question, Surface>({
  ask,
  answered: (_, surface) => set({ surface, state: "ready", failure: null }),
  failed: (_, error) => {
    // Asked again with the next telemetry, which `pause_ms` keeps from being a storm.
    asked = null;
    set({ surface: null, state: "failed", failure: sentenceOf(error) });
  },
  late: () => {},
  interval_ms: 500,
  late_ms: 2000,
  pause_ms: 3000,
});

function drop(): void {
  asked = null;
  latest.stop();
  if (useEnergy.getState() !== NOTHING) set(NOTHING);
}

function update(): void {
  const { stream, model, connection } = useConsole.getState();
  if (useView.getState().overlay !== "energy") return drop();
  const question = model && energyQuestion(shown(stream), model);
  // Without telemetry or feet there is nothing to draw; without a server what was drawn stays.
  if (!question) return drop();
  if (question.key === asked || connection !== "open") return;
  asked = question.key;
  if (useEnergy.getState().state === "none") set({ state: "loading" });
  latest.want(question);
}

/** Keeps the surface up to date until the returned function is called. */
export function startEnergy(): () => void {
  const stops = [useConsole.subscribe(update), useView.subscribe(update)];
  update();
  return () => {
    for (const stop of stops) stop();
    drop();
  };
}
