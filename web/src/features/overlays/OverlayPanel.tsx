// What is laid over the ground, with its legend.

import { type ClassStyle, REACHABILITY, TRAVERSABILITY } from "../../scene/palette";
import { usePlanOptions } from "../../store/planOptions";
import { useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { useTerrain } from "../../store/terrain";
import { type Overlay, useView } from "../../store/view";
import { Segments } from "../../ui/Segments";
import { Swatch } from "../../ui/Swatch";
import { EnergyLegend } from "./EnergyLegend";
import { useReachIsOld } from "./useReachability";
import "./overlays.css";

const OVERLAYS: [Overlay, string][] = [
  ["none", "None"],
  ["traversability", "Traversability"],
  ["reachability", "Reachability"],
  ["energy", "Energy"],
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
  const { state, failure } = useReach();
  const stability = usePlanOptions((s) => s.stability);
  const old = useReachIsOld();
  if (leg === null) return <p className="quiet small">Choose a leg to see where it can stand.</p>;
  return (
    <>
      <Legend styles={REACHABILITY} />
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
    </>
  );
}

function Legend({ styles }: { styles: ClassStyle[] }) {
  return (
    <ul className="legend">
      {styles.map((style) => (
        <li key={style.value} className="row">
          <Swatch style={style} />
          {style.name}
        </li>
      ))}
    </ul>
  );
}
