// Pictures that are laid over the ground: what the cameras saw, and imported rasters, put together of tiles.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { DrapeShape, OverlayAnswer, TextureAnswer } from "../api/types";
import type { DrapeImage } from "../scene/ground";
import { useTerrain } from "./terrain";
import { useView } from "./view";

/** A picture of what it is named by: a version of the map, or a raster. */
export interface Drape extends DrapeImage {
  of: string;
}

export interface DrapesState {
  /** What the cameras saw of a version. */
  picture: Drape | null;
  answer: TextureAnswer | null;
  pictureState: "none" | "loading" | "ready" | "failed";
  pictureFailure: string | null;
  /** The rasters of the server; null before they have come. */
  rasters: OverlayAnswer[] | null;
  /** The one that is shown. */
  shown: string | null;
  raster: Drape | null;
  opacity: number;
  busy: boolean;
  failure: string | null;
}

export const useDrapes = create<DrapesState>(() => ({
  picture: null,
  answer: null,
  pictureState: "none",
  pictureFailure: null,
  rasters: null,
  shown: null,
  raster: null,
  opacity: 0.7,
  busy: false,
  failure: null,
}));

const set = useDrapes.setState;
const TILE = 256;
/** Longest side of a picture that every graphics card takes (px). */
const SIDE_MAX = 4096;

type Fetch = (x: number, y: number, signal: AbortSignal) => Promise<ArrayBuffer>;

async function assemble(
  of: string,
  shape: DrapeShape,
  fetch: Fetch,
  signal: AbortSignal,
): Promise<Drape> {
  const [nx, ny] = shape.size;
  const scale = Math.min(1, SIDE_MAX / Math.max(nx, ny));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(nx * scale));
  canvas.height = Math.max(1, Math.round(ny * scale));
  const context = canvas.getContext("2d");
  if (!context) throw new Error("The browser draws no pictures.");
  const places: [number, number][] = [];
  for (let y = 0; y < shape.tiles[1]; y++) {
    for (let x = 0; x < shape.tiles[0]; x++) places.push([x, y]);
  }
  const one = async () => {
    for (let place = places.pop(); place; place = places.pop()) {
      const [x, y] = place;
      const blob = new Blob([await fetch(x, y, signal)], { type: "image/png" });
      const image = await createImageBitmap(blob);
      const [w, h] = [image.width * scale, image.height * scale];
      const below = ny * scale - y * TILE * scale;
      context.drawImage(image, x * TILE * scale, below - h, w, h);
      image.close();
    }
  };
  await Promise.all([one(), one(), one(), one()]);
  const extent_m: [number, number] = [nx * shape.texel_m, ny * shape.texel_m];
  return { of, canvas, origin_m: shape.origin_m, extent_m };
}

let pictureFlight: AbortController | null = null;
let pictureOf = "";

function updatePicture(): void {
  const { version } = useTerrain.getState();
  if (useView.getState().overlay !== "picture") {
    // Chosen again, it is asked for again.
    if (useDrapes.getState().pictureState === "failed") pictureOf = "";
    return;
  }
  if (!version || version.version === pictureOf) return;
  const name = version.version;
  pictureOf = name;
  pictureFlight?.abort();
  const mine = new AbortController();
  pictureFlight = mine;
  set({ pictureState: "loading", pictureFailure: null, picture: null, answer: null });
  const load = async () => {
    const answer = await api.texture(name, mine.signal);
    const tile: Fetch = (x, y, signal) => api.textureTile(name, x, y, signal);
    const picture = await assemble(name, answer.shape, tile, mine.signal);
    if (!mine.signal.aborted) set({ answer, picture, pictureState: "ready" });
  };
  load().catch((error: unknown) => {
    if (mine.signal.aborted) return;
    set({ pictureState: "failed", pictureFailure: sentenceOf(error) });
  });
}

/** Asks again which rasters there are. */
export async function loadRasters(): Promise<void> {
  try {
    const { overlays } = await api.rasters();
    set({ rasters: overlays });
    const { shown } = useDrapes.getState();
    if (shown !== null && overlays.every((each) => each.id !== shown)) void showRaster(null);
  } catch (error) {
    set({ failure: sentenceOf(error) });
  }
}

let rasterFlight: AbortController | null = null;

/** Shows a raster, or none. */
export async function showRaster(id: string | null): Promise<void> {
  rasterFlight?.abort();
  const mine = new AbortController();
  rasterFlight = mine;
  const chosen = useDrapes.getState().rasters?.find((each) => each.id === id) ?? null;
  set({ shown: chosen?.id ?? null, raster: null, failure: null });
  if (!chosen) return;
  try {
    const tile: Fetch = (x, y, signal) => api.rasterTile(chosen.id, x, y, signal);
    const raster = await assemble(chosen.id, chosen.shape, tile, mine.signal);
    if (!mine.signal.aborted) set({ raster });
  } catch (error) {
    if (!mine.signal.aborted) set({ shown: null, failure: sentenceOf(error) });
  }
}

/** Puts a file on the server and lays it over the ground. */
export async function addRaster(file: File): Promise<void> {
  set({ busy: true, failure: null });
  try {
    const name = file.name.replace(/[^A-Za-z0-9._-]/g, "_").slice(-64);
    await api.putTerrainFile(name, file);
    const { id } = await api.addRaster(name);
    await loadRasters();
    await showRaster(id);
  } catch (error) {
    set({ failure: sentenceOf(error) });
  } finally {
    set({ busy: false });
  }
}

export async function removeRaster(id: string): Promise<void> {
  try {
    await api.removeRaster(id);
  } catch (error) {
    set({ failure: sentenceOf(error) });
  }
  await loadRasters();
}

/** Keeps pictures up to date until the returned function is called. */
export function startDrapes(): () => void {
  let offset = "";
  const onMap = () => {
    updatePicture();
    // Another ground has no rasters of the one before.
    const { version } = useTerrain.getState();
    const next = version ? `${String(version.frame_offset_m)}|${version.source}` : "";
    if (next === offset) return;
    offset = next;
    void loadRasters();
  };
  onMap();
  const stops = [useTerrain.subscribe(onMap), useView.subscribe(updatePicture)];
  return () => stops.forEach((stop) => stop());
}
