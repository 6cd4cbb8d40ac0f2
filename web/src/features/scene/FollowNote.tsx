// What the plan to the place under the pointer comes to, beside that place.

import { type RefObject, useLayoutEffect } from "react";

import type { PlanAnalysis, Vec3 } from "../../api/types";
import { capital, legLabel, metres } from "../../lib/format";
import { leastOf, planMargins } from "../../lib/planMargins";
import { inTheWayOf, milliseconds, tookMs, whySentence } from "../../lib/planWords";
import type { Viewer } from "../../scene/viewer";
import { FOLLOW_DEADLINE_S, useFollow } from "../../store/follow";

interface Props {
  note: RefObject<HTMLDivElement | null>;
  viewer: RefObject<Viewer | null>;
}

export function FollowNote({ note, viewer }: Props) {
  const { shown, late, failure } = useFollow();
  useLayoutEffect(() => {
    if (viewer.current) placeNote(note.current, viewer.current);
  });
  if (failure) {
    return (
      <div className="follow-note failed small" data-testid="follow" data-outcome="failed">
        {failure}
      </div>
    );
  }
  if (!shown) return null;
  const { answer, target_m } = shown;
  return (
    <div
      ref={note}
      className={late ? "follow-note small late" : "follow-note small"}
      data-testid="follow"
      data-outcome={answer.outcome}
    >
      {answer.outcome === "found" ? (
        <Found answer={answer} />
      ) : (
        <Missing answer={answer} target_m={target_m} />
      )}
    </div>
  );
}

function Found({ answer }: { answer: PlanAnalysis }) {
  const margins = planMargins(answer);
  const least = margins && leastOf(margins);
  const shifts = answer.waypoints.some((w) => w.phase === "shift");
  return (
    <>
      <strong>{capital(legLabel(answer.leg))} can step here</strong>
      {shifts && <span>after a shift of the body</span>}
      <Took answer={answer}>{least && `least margin ${metres(least.margin_m)}`}</Took>
    </>
  );
}

function Missing({ answer, target_m }: { answer: PlanAnalysis; target_m: Vec3 }) {
  const near = answer.nearest_m;
  if (answer.outcome === "deadline") {
    return (
      <>
        <strong>{capital(legLabel(answer.leg))}: no answer at a glance</strong>
        <span>Not decided within {FOLLOW_DEADLINE_S} s; a plan searches for longer.</span>
      </>
    );
  }
  // Out of reach by so much says it all; of the rest the server knows more.
  const why = answer.constraint?.name === "reach" ? null : whySentence(answer);
  return (
    <>
      <strong>{inTheWayOf(answer)}</strong>
      {why && <span className="follow-why">{why}</span>}
      <Took answer={answer}>
        {near &&
          `nearest place ${metres(Math.hypot(near[0] - target_m[0], near[1] - target_m[1]))} away`}
      </Took>
    </>
  );
}

function Took({ answer, children }: { answer: PlanAnalysis; children: React.ReactNode }) {
  return (
    <span className="follow-took">
      {children}
      <span className="num" title="Time the answer took on the server">
        {milliseconds(tookMs(answer.statistics))}
      </span>
    </span>
  );
}

const BESIDE_PX = 20;
const EDGE_PX = 8;
/** Height of what is drawn at the bottom edge (px). */
const FOOT_PX = 56;

/** Beside the place it is for, within what the panels leave free; no render of React is needed. */
export function placeNote(note: HTMLDivElement | null, viewer: Viewer): void {
  const { shown } = useFollow.getState();
  if (!note || !shown) return;
  const at = viewer.project(...shown.target_m);
  note.style.visibility = at ? "visible" : "hidden";
  if (!at) return;
  const { left, right, width, height } = viewer.free();
  const [w, h] = [note.offsetWidth, note.offsetHeight];
  // Below the place, for the leg stands above it; above only where there is no room.
  const x = Math.min(at.x + BESIDE_PX, width - right - EDGE_PX - w);
  const under = at.y + BESIDE_PX + h < height - FOOT_PX;
  const y = under ? at.y + BESIDE_PX : at.y - BESIDE_PX - h;
  const [toX, toY] = [Math.max(x, left + EDGE_PX), Math.max(y, EDGE_PX)];
  note.style.transform = `translate(${Math.round(toX)}px, ${Math.round(toY)}px)`;
}
