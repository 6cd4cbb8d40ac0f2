// How plans are to be made: what the operator chose for those that follow, preview and plan alike.

import { create } from "zustand";

import type { PlanRequest, StabilityPreference, Vec3 } from "../api/types";

export interface PlanOptions {
  planner: NonNullable<PlanRequest["planner"]>;
  /** What must hold while the leg is up; asked of plans and of reachability alike. */
  stability: StabilityPreference;
  /** Height of the waypoints above start and goal (m); null is the server's own. */
  lift_m: number | null;
  /** The ground is raised by this much for the transit (m). */
  terrain_lift_m: number | null;
  /** Clearance added about obstacles (m). */
  obstacle_m: number | null;
  shift: NonNullable<PlanRequest["shift"]>;
  preload: boolean;
  drive_hold: boolean;
  seed: number;
}

export const DEFAULT_OPTIONS: PlanOptions = {
  planner: "auto",
  stability: "regular",
  lift_m: null,
  terrain_lift_m: null,
  obstacle_m: null,
  shift: "auto",
  preload: true,
  drive_hold: false,
  seed: 1,
};

/** What the server takes (m). */
export const BOUNDS_M = { lift_m: 2, terrain_lift_m: 1, obstacle_m: 1 } as const;

export const usePlanOptions = create<PlanOptions>(() => DEFAULT_OPTIONS);

export function resetOptions(): void {
  usePlanOptions.setState(DEFAULT_OPTIONS);
}

/** Names of the options that are not as the server has them by itself. */
export function chosenOptions(options: PlanOptions): (keyof PlanOptions)[] {
  const keys = Object.keys(DEFAULT_OPTIONS) as (keyof PlanOptions)[];
  return keys.filter((key) => options[key] !== DEFAULT_OPTIONS[key]);
}

/** The request for a step of `leg` to a place; what was not chosen is left to the server. */
export function planRequest(
  leg: string,
  target_m: Vec3,
  options: PlanOptions = usePlanOptions.getState(),
): PlanRequest {
  const { terrain_lift_m, obstacle_m, ...plain } = options;
  const chosen = new Set<string>(chosenOptions(options));
  const own = Object.fromEntries(Object.entries(plain).filter(([key]) => chosen.has(key)));
  const buffers = {
    ...(terrain_lift_m !== null && { terrain_lift_m }),
    ...(obstacle_m !== null && { obstacle_m }),
  };
  return {
    leg,
    target: { position_m: target_m },
    ...own,
    ...(Object.keys(buffers).length > 0 && { buffers }),
  };
}
