// What is shown and how: this console's own business, kept in the browser.

import { create } from "zustand";

import { setOperator } from "../api/client";
import { REGION_KEYS, type RegionKey } from "../lib/regions";

export type Overlay =
  "none" | "traversability" | "reachability" | "energy" | "map" | "picture" | "coverage";
export type CameraView = "iso" | "top" | "leg";
/** What is commanded by hand. */
export type HandPart = "leg" | "wheels" | "body" | "sequence";
export type RightTab = "step" | "hand" | "map" | "stability" | "telemetry" | "log";

export interface ViewState {
  overlay: Overlay;
  forces: boolean;
  polygons: boolean;
  /** Which of them are drawn. */
  regions: RegionKey[];
  torqueColors: boolean;
  theme: "dark" | "light";
  operator: string;
  camera: CameraView;
  /** Counts requests to aim the camera, so that asking for the same view again does it. */
  aimed: number;
  tab: RightTab;
  handPart: HandPart;
  rightOpen: boolean;
  leftOpen: boolean;
  keysOpen: boolean;
  importOpen: boolean;
  /** A pose predicted for now is drawn beside the reported one. */
  predicted: boolean;
  /** A plan to the place under the pointer is asked for and drawn. */
  follow: boolean;
}

const KEPT = [
  "forces",
  "polygons",
  "regions",
  "torqueColors",
  "theme",
  "operator",
  "follow",
] as const;
const STORAGE_KEY = "footfall.view";

function kept(): Partial<ViewState> {
  try {
    const stored = JSON.parse(localStorage.getItem(STORAGE_KEY) ?? "{}") as Partial<ViewState>;
    const told = Object.fromEntries(KEPT.filter((k) => k in stored).map((k) => [k, stored[k]]));
    // An older console may have kept something else under this name.
    if (!Array.isArray(told.regions)) delete told.regions;
    // What every console was called before names were given.
    if (told.operator === "operator") delete told.operator;
    return told;
  } catch {
    return {};
  }
}

/** A name of its own for each browser: two consoles are then two operators until they are told who they are. */
function newOperator(): string {
  const letters = "abcdefghjkmnpqrstuvwxyz23456789";
  const drawn = Array.from(crypto.getRandomValues(new Uint8Array(3)));
  return `operator-${drawn.map((b) => letters[b % letters.length]).join("")}`;
}

export const useView = create<ViewState>(() => ({
  overlay: "none",
  forces: false,
  polygons: true,
  regions: ["regular", "conservative"],
  torqueColors: false,
  theme: "dark",
  operator: newOperator(),
  camera: "iso",
  aimed: 0,
  tab: "step",
  handPart: "leg",
  rightOpen: true,
  leftOpen: true,
  keysOpen: false,
  importOpen: false,
  predicted: false,
  follow: true,
  ...kept(),
}));

function apply(state: ViewState): void {
  setOperator(state.operator);
  document.documentElement.dataset.theme = state.theme;
}

function keep(state: ViewState): void {
  try {
    const values = Object.fromEntries(KEPT.map((k) => [k, state[k]]));
    localStorage.setItem(STORAGE_KEY, JSON.stringify(values));
  } catch {
    // A browser that keeps nothing still shows everything.
  }
}

apply(useView.getState());
// The name that was drawn is this browser's from now on.
keep(useView.getState());
useView.subscribe((state, before) => {
  if (!KEPT.some((k) => state[k] !== before[k])) return;
  apply(state);
  keep(state);
});

/** Draws a kind of region or not, in the order of the kinds. */
export function setRegion(key: RegionKey, on: boolean): void {
  const { regions } = useView.getState();
  useView.setState({
    regions: REGION_KEYS.filter((k) => (k === key ? on : regions.includes(k))),
  });
}

export function aim(camera: CameraView): void {
  useView.setState((s) => ({ camera, aimed: s.aimed + 1 }));
}

export function nextView(): void {
  const order: CameraView[] = ["iso", "top", "leg"];
  aim(order[(order.indexOf(useView.getState().camera) + 1) % order.length]!);
}
