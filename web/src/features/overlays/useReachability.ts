// Keeps the reachability of the chosen leg up to date while it is looked at.

import { useEffect } from "react";

import { useChannels, useConsole } from "../../store/console";
import { usePlanOptions } from "../../store/planOptions";
import { askReach, dropReach, reachBasis, shownBasis, useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { useView } from "../../store/view";

function useBasis(): string | null {
  const stability = usePlanOptions((s) => s.stability);
  return reachBasis(useConsole(shownBasis), stability);
}

export function useReachIsOld(): boolean {
  const basis = useBasis();
  const of = useReach((s) => s.basis);
  return of !== null && of !== basis;
}

/** Waits until the stance has been still for this long before asking again (ms). */
const STILL_MS = 600;

export function useReachability(): void {
  const leg = useSelection((s) => s.leg);
  const wanted = useView((s) => s.overlay === "reachability");
  const open = useConsole((s) => s.connection === "open");
  const idle = useChannels((c) => c.rover?.message.mode !== "executing");
  const basis = useBasis();
  const stability = usePlanOptions((s) => s.stability);
  useEffect(() => {
    if (!wanted || leg === null) dropReach();
    else if (open && idle && basis !== null) {
      const known = useReach.getState();
      if (known.leg === leg && known.basis === basis) return;
      const wait = known.leg === leg && known.grid ? STILL_MS : 0;
      const timer = setTimeout(() => void askReach(leg, stability, basis), wait);
      return () => clearTimeout(timer);
    }
  }, [wanted, leg, open, idle, basis, stability]);
}
