// The layer of the map that is laid over the ground: its tiles, as classes of the shown version.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import { readClassTile, readValueTile, type RasterHeader } from "../api/tiles";
import type { TerrainVersion } from "../api/types";
import { classify, differenceClass, layersOf, type MapLayer, TILE_LAYER } from "../lib/mapLayers";
import type { RasterShape } from "../scene/heightRaster";
import { serverNow } from "./clock";
import { eachTile, useTerrain } from "./terrain";
import { useView } from "./view";

export interface MapLayerState {
  layer: MapLayer;
  /** Of which version, once it has come. */
  shown: { of: string; layer: MapLayer; shape: RasterShape; classes: Uint8Array } | null;
  state: "none" | "loading" | "ready" | "failed";
  failure: string | null;
}

export const useMapLayer = create<MapLayerState>(() => ({
  layer: "seen",
  shown: null,
  state: "none",
  failure: null,
}));

const set = useMapLayer.setState;

/** Lays a layer over the ground. */
export function showLayer(layer: MapLayer): void {
  set({ layer });
  useView.setState({ overlay: "map" });
  update();
}

/** The layer that is shown of a version: the chosen one where it has it. */
export function layerShown(layer: MapLayer, version: TerrainVersion | null): MapLayer | null {
  const all = layersOf(version);
  return all.includes(layer) ? layer : (all[0] ?? null);
}

interface Grid<T extends Float32Array | Uint8Array> {
  shape: RasterShape;
  values: T;
}

function fill<T extends Float32Array | Uint8Array>(
  grid: Grid<T>,
  header: RasterHeader,
  values: T,
): void {
  const { origin_m, resolution_m, size } = grid.shape;
  const col0 = Math.round((header.origin_m[0] - origin_m[0]) / resolution_m);
  const row0 = Math.round((header.origin_m[1] - origin_m[1]) / resolution_m);
  const [w, h] = header.size;
  for (let row = 0; row < h; row++) {
    const [j, n] = [row + row0, Math.min(w, size[0] - col0)];
    if (j < 0 || j >= size[1] || col0 < 0 || n <= 0) continue;
    grid.values.set(values.subarray(row * w, row * w + n) as never, j * size[0] + col0);
  }
}

const shapeOf = ({ origin_m, resolution_m, size }: TerrainVersion): RasterShape => ({
  origin_m,
  resolution_m,
  size,
});

async function valuesOf(version: TerrainVersion, layer: string, signal: AbortSignal) {
  const shape = shapeOf(version);
  const grid = { shape, values: new Float32Array(shape.size[0] * shape.size[1]).fill(NaN) };
  let time_ns = 0n;
  await eachTile(version, async (x, y) => {
    const tile = readValueTile(await api.tile(version.version, layer, x, y, signal));
    time_ns = tile.header.time_ns;
    fill(grid, tile.header, tile.values);
  });
  return { ...grid, time_ms: Number(time_ns / 1_000_000n) };
}

async function classesOf(version: TerrainVersion, layer: string, signal: AbortSignal) {
  const shape = shapeOf(version);
  const grid = { shape, values: new Uint8Array(shape.size[0] * shape.size[1]) };
  await eachTile(version, async (x, y) => {
    const tile = readClassTile(await api.tile(version.version, layer, x, y, signal));
    fill(grid, tile.header, tile.classes);
  });
  return grid.values;
}

/** Node by node against the version before, which may have another grid. */
async function difference(version: TerrainVersion, signal: AbortSignal): Promise<Uint8Array> {
  const { versions } = await api.terrainVersions();
  const before = versions.find((v) => v.version === version.changes?.since);
  if (!before) throw new Error("The version before is no longer kept.");
  const now = await valuesOf(version, "height", signal);
  const old = await valuesOf(before, "height", signal);
  const { origin_m, resolution_m, size } = now.shape;
  const node = (axis: 0 | 1, i: number) =>
    Math.round(
      (origin_m[axis] + i * resolution_m - old.shape.origin_m[axis]) / old.shape.resolution_m,
    );
  const classes = new Uint8Array(now.values.length);
  for (let row = 0; row < size[1]; row++) {
    const v = node(1, row);
    for (let col = 0; col < size[0]; col++) {
      const u = node(0, col);
      const inside = u >= 0 && v >= 0 && u < old.shape.size[0] && v < old.shape.size[1];
      const was = inside ? old.values[v * old.shape.size[0] + u]! : NaN;
      const i = row * size[0] + col;
      classes[i] = differenceClass(was, now.values[i]!);
    }
  }
  return classes;
}

async function load(
  layer: MapLayer,
  version: TerrainVersion,
  signal: AbortSignal,
): Promise<Uint8Array> {
  if (layer === "seen" || layer === "source") {
    return classesOf(version, TILE_LAYER[layer], signal);
  }
  if (layer === "difference") return difference(version, signal);
  const { values, time_ms } = await valuesOf(version, TILE_LAYER[layer], signal);
  // Tiles tell the age at the newest capture; what has passed since counts too.
  const since_s = layer === "age" ? Math.max(0, (serverNow() - time_ms) / 1000) : 0;
  return classify(layer, values, version, since_s);
}

let flight: AbortController | null = null;
let key = "";

function update(): void {
  const { version } = useTerrain.getState();
  const layer = layerShown(useMapLayer.getState().layer, version);
  if (useView.getState().overlay !== "map" || !version || layer === null) return;
  const next = `${version.version}|${layer}`;
  if (next === key) return;
  key = next;
  flight?.abort();
  const mine = new AbortController();
  flight = mine;
  set({ state: "loading", failure: null });
  load(layer, version, mine.signal).then(
    (classes) => {
      if (mine.signal.aborted) return;
      const shown = { of: version.version, layer, shape: shapeOf(version), classes };
      set({ shown, state: "ready" });
    },
    (error: unknown) => {
      if (mine.signal.aborted) return;
      key = "";
      set({ shown: null, state: "failed", failure: sentenceOf(error) });
    },
  );
}

const AGE_AGAIN_MS = 30_000;

/** Keeps the layer that is shown up to date until the returned function is called. */
export function startMapLayer(): () => void {
  const stops = [useTerrain, useView, useMapLayer].map((store) =>
    (store.subscribe as (listener: () => void) => () => void)(update),
  );
  const again = setInterval(() => {
    if (useMapLayer.getState().layer !== "age") return;
    key = "";
    update();
  }, AGE_AGAIN_MS);
  return () => {
    stops.forEach((stop) => stop());
    clearInterval(again);
  };
}
