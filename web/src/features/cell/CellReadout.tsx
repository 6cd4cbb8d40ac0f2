// What is known of the picked or pointed-at place, and why the leg cannot stand there.

import { useEffect, useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { CellAnswer, Vec3 } from "../../api/types";
import { cameraLabel } from "../../lib/cameras";
import { doubtOf } from "../../lib/doubt";
import { capital, degrees, legLabel, metres, signless } from "../../lib/format";
import { formatAge, parseTime } from "../../lib/time";
import { canStand, type Help, isOutOfPlan, reachStyle, whatHelps, whyNot } from "../../lib/whyNot";
import { TRAVERSABILITY } from "../../scene/palette";
import { useServerNow } from "../../store/now";
import { usePlanOptions } from "../../store/planOptions";
import { reachAt, type ReachCell, shownScene, useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { classAt, useTerrain } from "../../store/terrain";
import { useView } from "../../store/view";
import { Swatch } from "../../ui/Swatch";
import { useReachIsOld } from "../overlays/useReachability";
import "./cell.css";

const ASK_AFTER_MS = 180;

/** The server's knowledge of a place, asked for once the pointer rests. */
function useCell(point: Vec3 | null): { cell: CellAnswer | null; failure: string | null } {
  const version = useTerrain((s) => s.version?.version ?? null);
  const [answer, setAnswer] = useState<{
    of: Vec3;
    cell: CellAnswer | null;
    failure: string | null;
  }>();
  useEffect(() => {
    if (!point || version === null) return;
    const abort = new AbortController();
    const timer = setTimeout(() => {
      api.cell(version, point[0], point[1], abort.signal).then(
        (cell) => setAnswer({ of: point, cell, failure: null }),
        (error: unknown) => {
          if (!abort.signal.aborted)
            setAnswer({ of: point, cell: null, failure: sentenceOf(error) });
        },
      );
    }, ASK_AFTER_MS);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [point, version]);
  return answer && answer.of === point ? answer : { cell: null, failure: null };
}

export function CellReadout() {
  const pick = useSelection((s) => s.pick);
  const hover = useSelection((s) => s.hover);
  const point = hover ?? pick;
  const { cell, failure } = useCell(point);
  const raster = useTerrain((s) => s.raster);
  if (!point) {
    return (
      <section className="cell panel" aria-label="Place">
        <p className="quiet">Point at the ground to read it, click to pick a footfall.</p>
        <PickLine pick={pick} />
      </section>
    );
  }
  const known = raster?.knownAt(point[0], point[1]) ?? false;
  const kind = cell?.class ?? classAt(point[0], point[1]);
  return (
    <section className="cell panel" aria-label="Place">
      <div className="row between">
        <h2>{hover ? "Under the pointer" : "Picked place"}</h2>
        <span className="num">
          {signless(point[0], 2)}, {signless(point[1], 2)}
        </span>
      </div>
      <dl className="cell-facts">
        <Fact name="height" value={known ? metres(cell?.height_m ?? point[2]) : "not seen"} />
        <Fact name="slope" value={degrees(cell?.slope_rad)} />
        <Fact name="step" value={metres(cell?.step_m)} />
        <Fact name="rough" value={metres(cell?.roughness_m, 3)} />
        <Fact
          name="ground"
          value={TRAVERSABILITY.find((s) => s.value === kind)?.name ?? "unknown"}
        />
        <Fact name="certain" value={cell?.certainty == null ? "–" : cell.certainty.toFixed(2)} />
      </dl>
      {cell?.seen && <SeenBy seen={cell.seen} />}
      {cell?.doubt && <Doubt doubt={cell.doubt} kind={cell.class} />}
      <WhyNot point={point} />
      {failure && <p className="quiet small">{failure}</p>}
      <PickLine pick={pick} shown={pick !== null} />
    </section>
  );
}

/** Who saw the place, when, and how sure its height is. */
function SeenBy({ seen }: { seen: NonNullable<CellAnswer["seen"]> }) {
  const now = useServerNow();
  const who = seen.prior
    ? "map from before"
    : seen.camera
      ? cameraLabel(seen.camera)
      : "a wheel stood here";
  const age_s = (now - parseTime(seen.capture_time)) / 1000;
  return (
    <p className="small cell-seen" data-testid="cell-seen">
      <span className="cell-seen-who">{capital(who)}</span>
      {!seen.prior && (
        <span className="num quiet">
          {" "}
          {formatAge(age_s)} ago, ±{(100 * seen.sigma_m).toFixed(1)} cm, {seen.observations}×
        </span>
      )}
      {seen.hidden && <span className="trouble"> hidden by the robot now</span>}
    </p>
  );
}

/** That doubt of the heights is in the class, and what it changed. */
function Doubt({ doubt, kind }: { doubt: NonNullable<CellAnswer["doubt"]>; kind: number }) {
  const text = doubtOf(doubt, kind);
  return (
    text && (
      <p className="small quiet" data-testid="cell-doubt">
        {text}
      </p>
    )
  );
}

function Fact({ name, value }: { name: string; value: string }) {
  return (
    <div className="cell-fact">
      <dt>{name}</dt>
      <dd className="num">{value}</dd>
    </div>
  );
}

/** What the chosen leg makes of the place; asks for the answer to be made where there is none yet. */
function WhyNot({ point }: { point: Vec3 }) {
  const leg = useSelection((s) => s.leg);
  const { grid, leg: of, state } = useReach();
  const overlay = useView((s) => s.overlay);
  const old = useReachIsOld();
  if (leg === null) return null;
  const reach = of === leg && grid ? reachAt(grid, point[0], point[1]) : null;
  if (reach) return <Verdict reach={reach} leg={leg} old={old} point={point} />;
  const who = capital(legLabel(leg));
  if (grid && of === leg) return <p className="quiet small">{who}: farther than was looked at.</p>;
  if (overlay === "reachability")
    return state === "loading" ? <p className="quiet small">{who}: computing…</p> : null;
  return (
    <button
      type="button"
      className="button bare why-ask"
      data-testid="why-ask"
      onClick={() => useView.setState({ overlay: "reachability" })}
    >
      Can {legLabel(leg)} stand here? <kbd>r</kbd>
    </button>
  );
}

interface VerdictProps {
  reach: ReachCell;
  leg: string;
  old: boolean;
  point: Vec3;
}

function Verdict({ reach, leg, old, point }: VerdictProps) {
  const style = reachStyle(reach.class);
  const { verdict, reason, missing, margin } = whyNot(reach);
  return (
    <div className="why-not" data-testid="why-not">
      <p className="row">
        {style && <Swatch style={style} />}
        <strong>
          {capital(legLabel(leg))}: {verdict}
        </strong>
      </p>
      {reason && <p>{capital(reason)}</p>}
      {(missing ?? margin) !== null && (
        <dl className="cell-facts">
          {missing !== null && <Fact name="missing" value={missing} />}
          {margin !== null && <Fact name="margin" value={margin} />}
        </dl>
      )}
      {old && <p className="quiet small">For the stance before; computed anew</p>}
      {isOutOfPlan(reach.class) && !old && (
        <p className="small quiet">A plan to it (Enter) tells what is in the way.</p>
      )}
      {!canStand(reach.class) && !isOutOfPlan(reach.class) && !old && (
        <WhatHelps leg={leg} point={point} />
      )}
    </div>
  );
}

/** Time the pointer must rest before the server is asked to try what would help (ms). */
const TRY_AFTER_MS = 350;

/** What stands in the way by name, and the nearest change that was tried and helps. */
function WhatHelps({ leg, point }: { leg: string; point: Vec3 }) {
  const stability = usePlanOptions((s) => s.stability);
  const [answer, setAnswer] = useState<{ of: Vec3; leg: string; help: Help }>();
  useEffect(() => {
    const abort = new AbortController();
    const tell = (help: Help) => setAnswer({ of: point, leg, help });
    const timer = setTimeout(() => {
      api.explainCell(leg, point, stability, shownScene(), abort.signal).then(
        (told) => tell(whatHelps(told, point)),
        (error: unknown) => {
          if (!abort.signal.aborted) tell({ what: null, mends: sentenceOf(error) });
        },
      );
    }, TRY_AFTER_MS);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [leg, point, stability]);
  const known = answer && answer.of === point && answer.leg === leg ? answer.help : null;
  return (
    <div className="small what-helps" data-testid="what-helps" aria-live="polite">
      {known?.what && <p className="quiet">{known.what}</p>}
      <p className={known ? "" : "quiet"}>{known ? known.mends : "Looking for what would help…"}</p>
    </div>
  );
}

function PickLine({ pick, shown = true }: { pick: Vec3 | null; shown?: boolean }) {
  return (
    <p className={shown ? "small quiet" : "sr"} data-testid="pick" aria-live="polite">
      {pick ? (
        <>
          Pick{" "}
          <span className="num">
            {signless(pick[0], 2)}, {signless(pick[1], 2)}, {signless(pick[2], 2)} m
          </span>
        </>
      ) : (
        "No place picked"
      )}
    </p>
  );
}
