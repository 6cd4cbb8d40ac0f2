// The keyboard. E-stop works wherever the focus is; all else not while typing.

import { useEffect } from "react";

import { useConsole } from "../../store/console";
import { stopRover } from "../../store/estop";
import { blockedBy } from "../../store/permission";
import { makePlan, togglePlaying, usePlan } from "../../store/plan";
import { changeReplay } from "../../store/replay";
import { chooseLeg, nudgePick, pickAt, useSelection } from "../../store/selection";
import { aim, nextView, type Overlay, useView } from "../../store/view";

export function useHotkeys(): void {
  useEffect(() => {
    document.addEventListener("keydown", onKey, { capture: true });
    return () => document.removeEventListener("keydown", onKey, { capture: true });
  }, []);
}

function onKey(event: KeyboardEvent): void {
  if (event.key === "F9" || (event.ctrlKey && event.key === ".")) {
    event.preventDefault();
    if (!event.repeat) void stopRover();
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target instanceof HTMLElement ? event.target : null;
  if (document.querySelector("dialog[open]")) return;
  // Escape belongs to an open popover first.
  if (event.key === "Escape" && document.querySelector(".popover")) return;
  if (target?.closest("input:not([type=radio], [type=checkbox], [type=range]), select, textarea"))
    return;
  if (target && isForIt(event.key, target)) return;
  if (act(event)) event.preventDefault();
}

/** Does what has the focus make something of the key itself? */
function isForIt(key: string, target: HTMLElement): boolean {
  if (key === "Enter") return target.closest("button, a, summary") !== null;
  if (key === " ") return target.closest("button, input, a, summary") !== null;
  if (key === "Home" || key === "End" || key.startsWith("Arrow")) {
    return target.closest("input, [role=tab]") !== null;
  }
  return false;
}

const STEP_M = 0.05;
const ARROWS: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** True if the key meant something. */
function act(event: KeyboardEvent): boolean {
  const arrow = ARROWS[event.key];
  if (arrow) {
    const step = event.shiftKey ? 5 * STEP_M : STEP_M;
    nudgePick(arrow[0] * step, arrow[1] * step);
    return true;
  }
  const leg = /^[1-9]$/.test(event.key)
    ? useConsole.getState().model?.legs[Number(event.key) - 1]
    : undefined;
  if (leg) {
    chooseLeg(leg.name);
    return true;
  }
  const action = ACTIONS[event.key];
  action?.();
  return action !== undefined;
}

const ACTIONS: Record<string, () => void> = {
  Enter: () => {
    const { leg, pick } = useSelection.getState();
    const free = blockedBy(useConsole.getState()) === null && usePlan.getState().job === null;
    if (leg !== null && pick && free) void makePlan(leg, pick);
  },
  Escape: () => {
    if (useSelection.getState().pick) pickAt(null);
    else chooseLeg(null);
  },
  h: () => useView.setState((s) => ({ follow: !s.follow })),
  p: togglePlaying,
  o: () => {
    const order: Overlay[] = [
      "none",
      "traversability",
      "reachability",
      "energy",
      "map",
      "coverage",
    ];
    useView.setState((s) => ({ overlay: order[(order.indexOf(s.overlay) + 1) % order.length]! }));
  },
  r: () =>
    useView.setState((s) => ({ overlay: s.overlay === "reachability" ? "none" : "reachability" })),
  m: () => useView.setState({ tab: "map", rightOpen: true }),
  v: nextView,
  f: () => aim("iso"),
  g: () => useView.setState((s) => ({ forces: !s.forces })),
  t: () => useView.setState((s) => ({ torqueColors: !s.torqueColors })),
  " ": () => {
    const replay = useConsole.getState().stream.replayState;
    if (replay) void changeReplay({ paused: !replay.paused });
  },
  "?": () => useView.setState({ keysOpen: true }),
};
