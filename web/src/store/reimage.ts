// The offered sequence for ground that a leg hides: lift the leg, ask the pairs again, place it.

import { create } from "zustand";

import type { Vec3 } from "../api/types";
import { parseTime } from "../lib/time";
import { type ReimageStage, stageOf } from "../lib/reimage";
import { useConsole } from "./console";
import { currentVersion, useVersions } from "./versions";

export interface ReimageState {
  /** The leg whose ground is to be uncovered. */
  leg: string | null;
  /** Ground that it hides, if that is known (m). */
  hole: Vec3 | null;
  /** When it was last seen to leave the ground, on board (ms). */
  lifted_ms: number | null;
  /** When it came down again. */
  placed_ms: number | null;
}

const NOTHING: ReimageState = { leg: null, hole: null, lifted_ms: null, placed_ms: null };

export const useReimage = create<ReimageState>(() => NOTHING);

export function offerReimage(leg: string | null, hole: Vec3 | null = null): void {
  if (leg !== useReimage.getState().leg) useReimage.setState({ ...NOTHING, leg, hole });
  else if (hole) useReimage.setState({ hole });
  follow();
}

/** Notes when the leg leaves the ground and comes back. */
function follow(): void {
  const { leg, lifted_ms, placed_ms } = useReimage.getState();
  const rover = useConsole.getState().stream.live.rover;
  if (leg === null || !rover) return;
  const stands = rover.message.contacts[leg];
  if (stands === false && (lifted_ms === null || placed_ms !== null)) {
    useReimage.setState({ lifted_ms: rover.onboard_ms, placed_ms: null });
  } else if (stands === true && lifted_ms !== null && placed_ms === null) {
    useReimage.setState({ placed_ms: rover.onboard_ms });
  }
}

useConsole.subscribe((now, before) => {
  if (now.stream.live.rover !== before.stream.live.rover) follow();
});

export function useReimageStage(): ReimageStage {
  const { lifted_ms, placed_ms } = useReimage();
  const captured = useVersions((s) => currentVersion(s)?.captured ?? null);
  const captured_ms = captured == null ? null : parseTime(captured);
  return stageOf({ lifted_ms, placed_ms, captured_ms });
}
