// Classes of the overlays: names, colours and hatching, for the ground's shader and the legend alike.
// Colours are FootFall's hues in a palette that is none of the status colours.

/** Hatching that the shader and the legend both know. */
export const HATCH = { none: 0, rising: 1, falling: 2, cross: 3, level: 4, dots: 5 } as const;
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

/** What the reason codes of a reachability grid mean. */
export const REASONS: Record<number, string> = {
  1: "out of reach",
  2: "a joint limit",
  3: "unknown ground",
  4: "too little stability margin",
  5: "a settling foot would tip the rover",
  6: "the leg would touch the ground",
  7: "the leg would touch the rover",
  8: "the lift waypoint is out of reach",
  9: "the lift waypoint collides",
  10: "a joint torque above its limit",
  11: "the ground is too steep or too rough",
};
