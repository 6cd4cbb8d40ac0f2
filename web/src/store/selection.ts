// The leg and the place the operator has in mind, and the cell under the pointer.

import { create } from "zustand";

import type { Vec3 } from "../api/types";
import { useConsole } from "./console";
import { useTerrain } from "./terrain";

export interface SelectionState {
  leg: string | null;
  /** The picked point of ground, in `world` (m). */
  pick: Vec3 | null;
  /** The point of ground under the pointer, in `world` (m). */
  hover: Vec3 | null;
}

export const useSelection = create<SelectionState>(() => ({ leg: null, pick: null, hover: null }));

export function chooseLeg(leg: string | null): void {
  const changed = useSelection.getState().leg !== leg;
  useSelection.setState(changed ? { leg, pick: null } : { leg });
}

export function pickAt(point: Vec3 | null): void {
  useSelection.setState({ pick: point });
}

export function hoverAt(point: Vec3 | null): void {
  useSelection.setState({ hover: point });
}

/** Moves the pick over the ground (m); without a pick it starts below the chosen wheel. */
export function nudgePick(dx: number, dy: number): void {
  const { leg, pick } = useSelection.getState();
  const raster = useTerrain.getState().raster;
  if (!raster) return;
  const contacts = useConsole.getState().stream.live.rover?.message.contact_points_m;
  const from = pick ?? (leg === null ? undefined : contacts?.[leg]);
  if (!from) return;
  const [x, y] = [from[0] + dx, from[1] + dy];
  if (raster.contains(x, y)) pickAt(raster.point(x, y));
}
