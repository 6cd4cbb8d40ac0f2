// What is known of the picked or pointed-at place, and why the leg cannot stand there.

import { useEffect, useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { CellAnswer, Vec3 } from "../../api/types";
import { degrees, metres, percent, signless } from "../../lib/format";
import { REACHABILITY, type Reason, REASONS, TRAVERSABILITY } from "../../scene/palette";
import { reachAt, type ReachCell, useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { classAt, useTerrain } from "../../store/terrain";
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
  const grid = useReach((s) => s.grid);
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
  const reach = grid && reachAt(grid, point[0], point[1]);
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
      {reach && <WhyNot reach={reach} />}
      {failure && <p className="quiet small">{failure}</p>}
      <PickLine pick={pick} />
    </section>
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

function shortBy(missing: number, unit: Reason["unit"]): string {
  if (unit === "rad") return degrees(missing);
  return unit === "share" ? percent(missing) : metres(missing);
}

/** In words: can the leg stand here, and if not, which check fails and by how much. */
export function whyNot(reach: ReachCell): string {
  const verdict = REACHABILITY.find((s) => s.value === reach.class)?.name ?? "unknown";
  if (reach.class === 4) {
    const margin = Number.isFinite(reach.margin_m) ? `, margin ${metres(reach.margin_m)}` : "";
    return `Reachable${margin}`;
  }
  const reason = REASONS[reach.reason];
  const short = Number.isFinite(reach.missing) && reach.missing > 0;
  const amount = short ? `, ${shortBy(reach.missing, reason?.unit ?? "m")} short` : "";
  return `${verdict.charAt(0).toUpperCase()}${verdict.slice(1)}${reason ? `: ${reason.text}${amount}` : amount}`;
}

function WhyNot({ reach }: { reach: ReachCell }) {
  const style = REACHABILITY.find((s) => s.value === reach.class);
  return (
    <p className="why-not" data-testid="why-not">
      <i style={{ background: style?.color }} aria-hidden />
      {whyNot(reach)}
    </p>
  );
}

function PickLine({ pick }: { pick: Vec3 | null }) {
  return (
    <p className="small quiet" data-testid="pick" aria-live="polite">
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
