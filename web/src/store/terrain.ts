// The map: fetched tile by tile when its version changes.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import { readClassTile, readValueTile } from "../api/tiles";
import type { TerrainVersion } from "../api/types";
import { HeightRaster } from "../scene/heightRaster";

export interface TerrainState {
  version: TerrainVersion | null;
  raster: HeightRaster | null;
  /** Traversability by node: 0 unknown, 1 unsafe, 2 caution, 3 safe. */
  classes: Uint8Array | null;
  state: "empty" | "loading" | "ready" | "failed";
  /** Share of tiles that have come, 0 to 1. */
  progress: number;
  failure: string | null;
}

export const useTerrain = create<TerrainState>(() => ({
  version: null,
  raster: null,
  classes: null,
  state: "empty",
  progress: 0,
  failure: null,
}));

const set = useTerrain.setState;
let wanted: AbortController | null = null;

export async function loadTerrain(name: string): Promise<void> {
  wanted?.abort();
  const mine = new AbortController();
  wanted = mine;
  set({ state: "loading", progress: 0, failure: null });
  try {
    const { versions } = await api.terrainVersions();
    const version = versions.find((v) => v.version === name);
    if (!version) throw new Error(`The server no longer has map ${name}.`);
    const raster = await heights(version, mine.signal);
    if (mine.signal.aborted) return;
    set({ version, raster, classes: null, state: "ready", progress: 1 });
    const classes = await traversability(version, mine.signal);
    if (!mine.signal.aborted) set({ classes });
  } catch (error) {
    if (!mine.signal.aborted) set({ state: "failed", failure: sentenceOf(error) });
  }
}

async function heights(version: TerrainVersion, signal: AbortSignal): Promise<HeightRaster> {
  const raster = new HeightRaster({
    origin_m: version.origin_m,
    resolution_m: version.resolution_m,
    size: version.size,
  });
  let done = 0;
  const count = version.tiles[0] * version.tiles[1];
  await eachTile(version, async (x, y) => {
    raster.place(readValueTile(await api.tile(version.version, "height", x, y, signal)));
    done += 1;
    if (!signal.aborted) set({ progress: done / count });
  });
  return raster.finish();
}

async function traversability(
  version: TerrainVersion,
  signal: AbortSignal,
): Promise<Uint8Array | null> {
  if (!version.layers.includes("class")) return null;
  const [w, h] = version.size;
  const classes = new Uint8Array(w * h);
  await eachTile(version, async (x, y) => {
    const tile = readClassTile(await api.tile(version.version, "class", x, y, signal));
    const { size, origin_m } = tile.header;
    const col0 = Math.round((origin_m[0] - version.origin_m[0]) / version.resolution_m);
    const row0 = Math.round((origin_m[1] - version.origin_m[1]) / version.resolution_m);
    for (let row = 0; row < size[1]; row++) {
      for (let col = 0; col < size[0]; col++) {
        const [i, j] = [col + col0, row + row0];
        if (i < 0 || j < 0 || i >= w || j >= h) continue;
        classes[j * w + i] = tile.classes[row * size[0] + col]!;
      }
    }
  });
  return classes;
}

/** Four tiles at a time. */
export async function eachTile(
  version: TerrainVersion,
  work: (x: number, y: number) => Promise<void>,
): Promise<void> {
  const [nx, ny] = version.tiles;
  const all = Array.from({ length: nx * ny }, (_, i) => [i % nx, Math.floor(i / nx)] as const);
  const worker = async () => {
    for (let next = all.shift(); next; next = all.shift()) await work(next[0], next[1]);
  };
  await Promise.all(Array.from({ length: Math.min(4, all.length) }, worker));
}

/** Traversability of the node nearest to a place; 0 outside. */
export function classAt(x: number, y: number): number {
  const { raster, classes } = useTerrain.getState();
  if (!raster || !classes || !raster.contains(x, y)) return 0;
  const { origin_m, resolution_m, size } = raster.shape;
  const col = Math.round((x - origin_m[0]) / resolution_m);
  const row = Math.round((y - origin_m[1]) / resolution_m);
  return classes[row * size[0] + col] ?? 0;
}
