// Classes of the overlays: names, colours and hatching, for the ground's shader and the legend alike.
// Colours are FootFall's hues in a palette that is none of the status colours.

import type { RegionKey } from "../lib/regions";

/** Hatching that the shader and the legend both know. */
export const HATCH = {
  none: 0,
  rising: 1,
  falling: 2,
  cross: 3,
  level: 4,
  dots: 5,
  upright: 6,
} as const;
export type Hatch = keyof typeof HATCH;

export interface ClassStyle {
  /** Class number on the wire. */
  value: number;
  name: string;
  color: string;
  hatch: Hatch;
  /** How strongly it tints the ground, 0 to 1. */
  strength: number;
}

export const UNKNOWN_STYLE = { color: "#77828e", hatch: "rising", strength: 0.35 } as const;

export const TRAVERSABILITY: ClassStyle[] = [
  { value: 3, name: "safe", color: "#3fa38b", hatch: "none", strength: 0.24 },
  { value: 2, name: "caution", color: "#cfa63f", hatch: "dots", strength: 0.5 },
  { value: 1, name: "unsafe", color: "#a83f3e", hatch: "cross", strength: 0.58 },
  { value: 0, name: "unknown", ...UNKNOWN_STYLE },
];

export const REACHABILITY: ClassStyle[] = [
  { value: 4, name: "reachable", color: "#3f9e6e", hatch: "none", strength: 0.55 },
  { value: 2, name: "unstable", color: "#d98a45", hatch: "level", strength: 0.5 },
  { value: 3, name: "no lift", color: "#4f78cf", hatch: "dots", strength: 0.55 },
  { value: 5, name: "colliding", color: "#a458b5", hatch: "cross", strength: 0.55 },
  { value: 1, name: "unreachable", color: "#a8434f", hatch: "falling", strength: 0.3 },
  { value: 0, name: "unknown", ...UNKNOWN_STYLE },
];

/** What becomes of reachable cells once a step to them was really planned. */
export const PLANNED: ClassStyle[] = [
  { value: 6, name: "plannable", color: "#5fd3a0", hatch: "none", strength: 0.62 },
  { value: 7, name: "no plan", color: "#b9a44a", hatch: "upright", strength: 0.6 },
];

/** A line's pattern: [length of a dash, length of a gap, start of the pattern] (m), laid over each other. */
export type Dash = [dash: number, gap: number, offset: number];

export interface RegionStyle {
  key: RegionKey;
  color: string;
  width: number;
  /** None is a line without gaps. */
  dashes: Dash[];
  /** The same pattern for a swatch (px). */
  stroke: string;
}

/** Regions of the center of mass, told apart by pattern as well as by color; later ones lie on top. */
export const REGIONS: RegionStyle[] = [
  { key: "regular", color: "#dce6f0", width: 1.6, dashes: [], stroke: "" },
  { key: "conservative", color: "#b9a6e8", width: 1.8, dashes: [[0.16, 0.1, 0]], stroke: "5 3" },
  { key: "friction", color: "#6fcfc0", width: 2.4, dashes: [[0.42, 0.2, 0]], stroke: "12 4" },
  { key: "frictionLoss", color: "#6fcfc0", width: 2.6, dashes: [[0.05, 0.11, 0]], stroke: "2 3" },
  {
    key: "torque",
    color: "#eba3bd",
    width: 2.2,
    dashes: [
      [0.3, 0.3, 0],
      [0.06, 0.54, -0.42],
    ],
    stroke: "9 3 2 3",
  },
];

/** What the reason codes of a reachability grid mean. */
export const REASONS: Record<number, Reason> = {
  1: { text: "out of reach", unit: "m" },
  2: { text: "a joint beyond its limit", unit: "rad" },
  3: { text: "nobody has seen the ground", unit: "m" },
  4: { text: "too little stability margin", unit: "m" },
  5: { text: "a settling foot would tip the rover", unit: "m" },
  6: { text: "the leg too near to the ground", unit: "m" },
  7: { text: "the leg too near to the rover", unit: "m" },
  8: { text: "the lift waypoint is out of reach", unit: "m" },
  9: { text: "something in the way at the lift waypoint", unit: "m" },
  10: { text: "a joint overloaded", unit: "share" },
  11: { text: "the ground under the wheel is too uneven", unit: "m" },
  12: { text: "the leg cannot be lifted where it stands", unit: "m" },
  13: { text: "ground unsafe for a wheel", unit: "goodness" },
  14: { text: "the leg can stand here, but no step to it was found", unit: "m" },
};

export interface Reason {
  text: string;
  /** Unit of the amount that is missing. */
  unit: "m" | "rad" | "share" | "goodness";
}
