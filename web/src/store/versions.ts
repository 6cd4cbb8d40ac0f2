// The versions of the map that the server keeps, and what can be done with them.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { TerrainVersion } from "../api/types";
import { useConsole } from "./console";

export interface VersionsState {
  versions: TerrainVersion[] | null;
  current: string | null;
  /** Something is being done to the map. */
  busy: boolean;
  failure: string | null;
}

export const useVersions = create<VersionsState>(() => ({
  versions: null,
  current: null,
  busy: false,
  failure: null,
}));

const set = useVersions.setState;
let asked = 0;

export async function loadVersions(): Promise<void> {
  const mine = ++asked;
  try {
    const { versions, current } = await api.terrainVersions();
    if (mine === asked) set({ versions, current });
  } catch (error) {
    if (mine === asked) set({ failure: sentenceOf(error) });
  }
}

async function change(work: () => Promise<unknown>): Promise<void> {
  if (useVersions.getState().busy) return;
  set({ busy: true, failure: null });
  try {
    await work();
    await loadVersions();
  } catch (error) {
    set({ failure: sentenceOf(error) });
  } finally {
    set({ busy: false });
  }
}

export const selectVersion = (version: string) => change(() => api.selectVersion(version));
export const removePair = (version: string, source: number) =>
  change(() => api.removePair(version, source));
export const fitPair = (version: string, source: number, fitted: boolean) =>
  change(() => api.fitPair(version, source, fitted));

/** The version in use, as far as it is known. */
export function currentVersion(state: VersionsState = useVersions.getState()) {
  return state.versions?.find((v) => v.version === state.current) ?? null;
}

/** The list changes with the map. */
useConsole.subscribe((now, before) => {
  if (now.liveTerrain !== before.liveTerrain && useVersions.getState().versions)
    void loadVersions();
});
