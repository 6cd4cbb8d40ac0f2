// What is laid over the ground, with its legend.

import { useMemo } from "react";

import { legLabel } from "../../lib/format";
import { PLANNED, REACHABILITY, TRAVERSABILITY } from "../../scene/palette";
import { useConsole } from "../../store/console";
import {
  cancelPlannable,
  type PlannedCount,
  plannedCount,
  planToCells,
  usePlannable,
} from "../../store/plannable";
import { usePlanOptions } from "../../store/planOptions";
import { useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { useTerrain } from "../../store/terrain";
import { type Overlay, useView } from "../../store/view";
import { JobRow } from "../../ui/JobRow";
import { Segments } from "../../ui/Segments";
import { EnergyLegend } from "./EnergyLegend";
import { Legend } from "./Legend";
import { CoverageLegend, MapLegend } from "./MapLegend";
import { PictureLegend } from "./PictureLegend";
import { Rasters } from "./Rasters";
import { useReachIsOld } from "./useReachability";
import "./overlays.css";

const OVERLAYS: [Overlay, string][] = [
  ["none", "None"],
  ["traversability", "Traversability"],
  ["reachability", "Reachability"],
  ["energy", "Energy"],
  ["map", "Map layer"],
  ["picture", "Picture"],
  ["coverage", "Coverage"],
];

export function OverlayPanel() {
  const overlay = useView((s) => s.overlay);
  return (
    <section className="section stack" aria-label="Overlay">
      <h2 id="overlay-title">Overlay</h2>
      <Segments
        name="overlay"
        labelledBy="overlay-title"
        choices={OVERLAYS}
        value={overlay}
        set={(value) => useView.setState({ overlay: value })}
        testId="overlay"
      />
      {overlay === "traversability" && <TraversabilityLegend />}
      {overlay === "reachability" && <ReachLegend />}
      {overlay === "energy" && <EnergyLegend />}
      {overlay === "map" && <MapLegend />}
      {overlay === "picture" && <PictureLegend />}
      {overlay === "coverage" && <CoverageLegend />}
      <Rasters />
    </section>
  );
}

function TraversabilityLegend() {
  const classes = useTerrain((s) => s.classes);
  if (!classes) return <p className="quiet small">This map has no traversability yet.</p>;
  return <Legend styles={TRAVERSABILITY} />;
}

function ReachLegend() {
  const leg = useSelection((s) => s.leg);
  const { state, failure, grid } = useReach();
  const stability = usePlanOptions((s) => s.stability);
  const busy = usePlannable((s) => s.of !== null);
  const old = useReachIsOld();
  const scale = useConsole((s) => s.model?.scale ?? 1);
  const planned = useMemo(() => (grid ? plannedCount(grid, scale) : null), [grid, scale]);
  if (leg === null) return <p className="quiet small">Choose a leg to see where it can stand.</p>;
  const anyPlanned = planned !== null && planned.found + planned.none > 0;
  return (
    <>
      {planned && (anyPlanned || busy) ? (
        <Legend
          styles={[...PLANNED, ...REACHABILITY]}
          counts={{ 6: planned.found, 7: planned.none, 4: planned.open }}
        />
      ) : (
        <Legend styles={REACHABILITY} />
      )}
      <p
        className="small quiet"
        role="status"
        data-testid="reach-state"
        data-state={old ? "old" : state}
      >
        {state === "loading" && "Computing…"}
        {state === "failed" && <span className="trouble">{failure}</span>}
        {state === "ready" && (old ? "Outdated: computed anew" : `For this stance, ${stability}`)}
      </p>
      {state === "ready" && planned && <PlannedCells key={leg} leg={leg} count={planned} />}
    </>
  );
}

/** Really planning to the reachable cells, and what came of it. */
function PlannedCells({ leg, count }: { leg: string; count: PlannedCount }) {
  const { of, job, failure } = usePlannable();
  const stability = usePlanOptions((s) => s.stability);
  const live = useConsole((s) => s.stream.replayState === null);
  if (!live) return <p className="quiet small">Plans to cells are made for the live rover only.</p>;
  if (of) {
    return of.leg === leg ? (
      <JobRow
        job={job && { ...job, doing: "Plans to cells" }}
        waiting="Waiting for a worker"
        cancel={cancelPlannable}
        testId="plannable"
      />
    ) : (
      <p className="row between small quiet">
        Plans to cells of {legLabel(of.leg)}
        <button type="button" className="button bare" onClick={cancelPlannable}>
          Cancel
        </button>
      </p>
    );
  }
  return (
    <>
      {count.squares > 0 && (
        <button
          type="button"
          className="button"
          data-testid="plan-to-cells"
          title="Plans a step to a reachable cell of each 10 cm square in the background, the nearest first"
          onClick={() => void planToCells(leg, stability)}
        >
          Plan to cells
        </button>
      )}
      {failure && <p className="small trouble">{failure}</p>}
    </>
  );
}
