// The layers of a map as classes that the ground shows and the legend explains: quantities in steps that read
// at a glance, classes as they are.

import type { TerrainVersion } from "../api/types";
import type { ClassStyle, Hatch } from "../scene/palette";

export type MapLayer = "seen" | "height" | "sigma" | "count" | "age" | "source" | "difference";

export const LAYER_NAMES: Record<MapLayer, string> = {
  seen: "Seen and hidden",
  height: "Height",
  sigma: "Sigma of height",
  count: "Observations",
  age: "Age",
  source: "Source",
  difference: "Difference to before",
};

/** The layer of the server's tiles that each is made of. */
export const TILE_LAYER: Record<MapLayer, string> = {
  seen: "mask",
  height: "height",
  sigma: "sigma",
  count: "count",
  age: "age",
  source: "source",
  difference: "height",
};

/** The layers that a version has. */
export function layersOf(version: TerrainVersion | null): MapLayer[] {
  if (!version) return [];
  const all = Object.keys(LAYER_NAMES) as MapLayer[];
  return all.filter((layer) =>
    layer === "difference" ? version.changes != null : version.layers.includes(TILE_LAYER[layer]),
  );
}

/** Even in lightness: dark is little, bright is much. */
const SCALE = ["#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#f2e51d"];
const NOTHING: ClassStyle = {
  value: 0,
  name: "unknown",
  color: "#2f3944",
  hatch: "rising",
  strength: 0.55,
};

function scaled(names: string[]): ClassStyle[] {
  const at = (i: number) => Math.round((i * (SCALE.length - 1)) / Math.max(1, names.length - 1));
  const steps = names.map((name, i) => ({
    value: i + 1,
    name,
    color: SCALE[at(i)]!,
    hatch: "none" as Hatch,
    strength: 0.62,
  }));
  return [...steps, NOTHING];
}

interface Steps {
  /** Upper ends of all steps but the last. */
  edges: number[];
  styles: ClassStyle[];
}

const FIXED: Record<"sigma" | "count" | "age", Steps> = {
  sigma: {
    edges: [0.005, 0.01, 0.02, 0.05, 0.1],
    styles: scaled(["< 5 mm", "5–10 mm", "1–2 cm", "2–5 cm", "5–10 cm", "> 10 cm"]),
  },
  count: {
    edges: [2, 4, 8, 16],
    styles: scaled(["1", "2–3", "4–7", "8–15", "16 and more"]),
  },
  age: {
    edges: [60, 600, 3600, 6 * 3600, 24 * 3600],
    styles: scaled(["< 1 min", "1–10 min", "10–60 min", "1–6 h", "6–24 h", "> 1 day"]),
  },
};

const HEIGHT_STEPS = 7;

/** Even steps over the heights of a map. */
export function heightSteps([low, high]: [number, number]): Steps {
  const step = Math.max(high - low, 1e-6) / HEIGHT_STEPS;
  const edge = (i: number) => low + i * step;
  const name = (i: number) => `${edge(i).toFixed(1)} to ${edge(i + 1).toFixed(1)} m`;
  return {
    edges: Array.from({ length: HEIGHT_STEPS - 1 }, (_, i) => edge(i + 1)),
    styles: scaled(Array.from({ length: HEIGHT_STEPS }, (_, i) => name(i).replaceAll("-", "−"))),
  };
}

/** How well the ground is seen, by the classes of the server's `mask`. */
export const SEEN: ClassStyle[] = [
  { value: 1, name: "seen", color: "#3f9db5", hatch: "none", strength: 0.42 },
  { value: 6, name: "wheel stood", color: "#5fd3a0", hatch: "none", strength: 0.6 },
  { value: 2, name: "robot in view", color: "#b9a6e8", hatch: "cross", strength: 0.55 },
  { value: 3, name: "robot's edge", color: "#8d7bc4", hatch: "dots", strength: 0.5 },
  { value: 4, name: "contradictory", color: "#d98a45", hatch: "level", strength: 0.6 },
  { value: 5, name: "map before", color: "#4a5663", hatch: "falling", strength: 0.5 },
  { ...NOTHING, name: "never seen" },
];

const SOURCE_COLORS = [
  "#5b8fd6",
  "#d9b24a",
  "#4fae8a",
  "#c46a8f",
  "#8f7ad0",
  "#c98352",
  "#58b6c4",
  "#a3b84f",
  "#b27fc0",
];

/** The sources of a version: the first two are the map from before and the wheels. */
export function sourceStyles(sources: string[]): ClassStyle[] {
  const styles = sources.slice(0, 11).map((name, i): ClassStyle => {
    const value = i + 1;
    if (i === 0) return { value, name, color: "#4a5663", hatch: "falling", strength: 0.5 };
    if (i === 1) return { value, name, color: "#5fd3a0", hatch: "dots", strength: 0.6 };
    const color = SOURCE_COLORS[(i - 2) % SOURCE_COLORS.length]!;
    return { value, name, color, hatch: "none", strength: 0.6 };
  });
  return [...styles, NOTHING];
}

/** Between two versions: what is new, gone, higher, lower (m). */
export const DIFFERENCE: ClassStyle[] = [
  { value: 1, name: "> 5 cm lower", color: "#3f6fd0", hatch: "none", strength: 0.7 },
  { value: 2, name: "1–5 cm lower", color: "#7fa3dd", hatch: "none", strength: 0.5 },
  { value: 3, name: "within 1 cm", color: "#9aa3ad", hatch: "none", strength: 0.12 },
  { value: 4, name: "1–5 cm higher", color: "#dba16a", hatch: "none", strength: 0.5 },
  { value: 5, name: "> 5 cm higher", color: "#c9642f", hatch: "none", strength: 0.7 },
  { value: 6, name: "new", color: "#4fae8a", hatch: "dots", strength: 0.6 },
  { value: 7, name: "gone", color: "#a85b8f", hatch: "cross", strength: 0.6 },
  NOTHING,
];

export function stylesOf(layer: MapLayer, version: TerrainVersion): ClassStyle[] {
  switch (layer) {
    case "seen":
      return SEEN;
    case "source":
      return sourceStyles(version.sources ?? []);
    case "difference":
      return DIFFERENCE;
    case "height":
      return heightSteps(version.z_range_m).styles;
    default:
      return FIXED[layer].styles;
  }
}

/** The step of each value: 1 and more, 0 where there is none. `offset` is added first. */
export function classify(
  layer: "height" | "sigma" | "count" | "age",
  values: Float32Array,
  version: TerrainVersion,
  offset = 0,
): Uint8Array {
  const { edges } = layer === "height" ? heightSteps(version.z_range_m) : FIXED[layer];
  return Uint8Array.from(values, (v) => {
    if (Number.isNaN(v) || (layer === "count" && v < 1)) return 0;
    const at = edges.findIndex((edge) => v + offset < edge);
    return (at < 0 ? edges.length : at) + 1;
  });
}

const SAME_M = 0.01;
const FAR_M = 0.05;

/** The class of a node whose height was `before` and is `now` (m); NaN is unknown. */
export function differenceClass(before: number, now: number): number {
  if (Number.isNaN(now)) return Number.isNaN(before) ? 0 : 7;
  if (Number.isNaN(before)) return 6;
  const off = now - before;
  if (Math.abs(off) < SAME_M) return 3;
  return off < 0 ? (off < -FAR_M ? 1 : 2) : off > FAR_M ? 5 : 4;
}
