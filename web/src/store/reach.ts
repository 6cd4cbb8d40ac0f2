// Where the chosen leg can stand: asked for when it is looked at, and again when it is outdated.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import { nodeAt, type ReachGrid, readReachGrid } from "../api/tiles";
import type { RoverState, Scene, StabilityPreference } from "../api/types";
import type { ReachCell } from "../lib/whyNot";
import { type ConsoleState, useConsole } from "./console";
import { shown } from "./streamState";

export type { ReachCell };

export interface ReachState {
  leg: string | null;
  grid: ReachGrid | null;
  /** Stance, map and preference that the grid belongs to. */
  basis: string | null;
  state: "none" | "loading" | "ready" | "failed";
  failure: string | null;
}

const NOTHING: ReachState = { leg: null, grid: null, basis: null, state: "none", failure: null };

export const useReach = create<ReachState>(() => NOTHING);

let asked: AbortController | null = null;

/** A text that changes when the stance moves by more than a hair or the map changes. */
export function stanceKey(state: RoverState, terrainVersion: string): string {
  const round = (v: number) => Math.round(v * 500);
  const pose = [...state.base.position_m, ...state.base.orientation_xyzw].map(round);
  const joints = Object.values(state.joints_rad).flat().map(round);
  return `${terrainVersion}|${pose.join()}|${joints.join()}`;
}

/** The key of the live rover as last reported; null without telemetry. */
export function liveBasis(state: ConsoleState = useConsole.getState()): string | null {
  const rover = state.stream.live.rover?.message;
  return rover && state.terrainVersion ? stanceKey(rover.state, state.terrainVersion) : null;
}

/** The same of what is shown, a replay's rover included. */
export function shownBasis(state: ConsoleState = useConsole.getState()): string | null {
  const rover = shown(state.stream).rover?.message;
  return rover && state.terrainVersion ? stanceKey(rover.state, state.terrainVersion) : null;
}

/** What is asked of a replay's rover goes with its state and map; the live one is known to the server. */
export function shownScene(state: ConsoleState = useConsole.getState()): Scene | undefined {
  if (!state.stream.replayState) return undefined;
  const rover = shown(state.stream).rover?.message;
  if (!rover) return undefined;
  const other = state.terrainVersion !== null && state.terrainVersion !== state.liveTerrain;
  const { base, joints_rad } = rover.state;
  return {
    state: { base, joints_rad },
    ...(other && { terrain: { version: state.terrainVersion } }),
  };
}

/** What an answer belongs to: the stance, the map, and what must hold while the leg is up. */
export function reachBasis(basis: string | null, stability: StabilityPreference): string | null {
  return basis === null ? null : `${stability}|${basis}`;
}

export async function askReach(
  leg: string,
  stability: StabilityPreference,
  basis: string,
): Promise<void> {
  asked?.abort();
  const mine = new AbortController();
  asked = mine;
  const before = useReach.getState();
  useReach.setState({
    leg,
    // An outdated grid of the same leg stays on screen until the new one is there.
    grid: before.leg === leg ? before.grid : null,
    state: "loading",
    failure: null,
  });
  try {
    const grid = readReachGrid(await bytesOf(leg, stability, basis, mine.signal));
    if (!mine.signal.aborted) useReach.setState({ grid, basis, state: "ready" });
  } catch (error) {
    if (mine.signal.aborted) return;
    useReach.setState({ grid: null, basis, state: "failed", failure: sentenceOf(error) });
  }
}

/** The bases whose cells were planned to from here, for legs: those cells are kept by the server. */
const planned = new Set<string>();

export function notePlanned(leg: string, basis: string): void {
  planned.add(`${leg}|${basis}`);
}

async function bytesOf(
  leg: string,
  stability: StabilityPreference,
  basis: string,
  signal: AbortSignal,
): Promise<ArrayBuffer> {
  const scene = shownScene();
  if (!scene && planned.has(`${leg}|${basis}`)) {
    const known = await api.liveReach();
    const { plannable = 0, not_plannable = 0 } = known.legs[leg]?.cells ?? {};
    if (known.stability === stability && plannable + not_plannable > 0) return api.liveCells(leg);
  }
  return api.reachability(leg, stability, scene, signal);
}

export function dropReach(): void {
  asked?.abort();
  asked = null;
  if (useReach.getState() !== NOTHING) useReach.setState(NOTHING);
}

export function reachAt(grid: ReachGrid, x: number, y: number): ReachCell | null {
  const i = nodeAt(grid.header, x, y);
  if (i < 0) return null;
  return {
    class: grid.classes[i]!,
    reason: grid.reasons[i]!,
    missing: grid.missing[i]!,
    margin_m: grid.margin[i]!,
  };
}
