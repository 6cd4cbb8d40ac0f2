// What is laid over the ground, with its legend, and what else is drawn.

import { HATCH, type ClassStyle, REACHABILITY, TRAVERSABILITY } from "../../scene/palette";
import { useReach } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { useTerrain } from "../../store/terrain";
import { type Overlay, useView } from "../../store/view";
import { useReachIsOld } from "./useReachability";
import "./overlays.css";

const OVERLAYS: [Overlay, string][] = [
  ["none", "None"],
  ["traversability", "Traversability"],
  ["reachability", "Reachability"],
];

export function OverlayPanel() {
  const overlay = useView((s) => s.overlay);
  return (
    <section className="section stack" aria-label="Overlay">
      <h2 id="overlay-title">Overlay</h2>
      <div className="segments" role="radiogroup" aria-labelledby="overlay-title">
        {OVERLAYS.map(([value, label]) => (
          <label key={value} className="segment">
            <input
              type="radio"
              name="overlay"
              value={value}
              data-testid={`overlay-${value}`}
              checked={overlay === value}
              onChange={() => useView.setState({ overlay: value })}
            />
            <span>{label}</span>
          </label>
        ))}
      </div>
      {overlay === "traversability" && <TraversabilityLegend />}
      {overlay === "reachability" && <ReachLegend />}
    </section>
  );
}

export function DrawingPanel() {
  const { forces, polygons, torqueColors } = useView();
  return (
    <section className="section drawing" aria-label="Drawing">
      <Toggle
        label="Polygons"
        title="Support polygons and center of mass"
        on={polygons}
        set={(on) => useView.setState({ polygons: on })}
      />
      <Toggle
        label="Forces"
        title="Wheel forces (g)"
        on={forces}
        set={(on) => useView.setState({ forces: on })}
      />
      <Toggle
        label="Torques"
        title="Joint torques as color (t)"
        on={torqueColors}
        set={(on) => useView.setState({ torqueColors: on })}
      />
    </section>
  );
}

function Toggle(props: { label: string; title: string; on: boolean; set: (on: boolean) => void }) {
  const { label, title, on, set } = props;
  return (
    <label className="check" title={title}>
      <input type="checkbox" checked={on} onChange={(event) => set(event.target.checked)} />
      {label}
    </label>
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
        {state === "ready" && (old ? "Outdated: the rover moved" : "For the present stance")}
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

const LINES: Record<number, string> = {
  [HATCH.none]: "",
  [HATCH.rising]: "M-2 14L14 -2M4 20L20 4M-8 8L8 -8",
  [HATCH.falling]: "M-2 2L10 14M6 -2L20 12",
  [HATCH.cross]: "M-2 14L14 -2M6 18L22 2M-2 -2L14 14M8 -4L24 12",
  [HATCH.level]: "M0 3h20M0 7h20M0 11h20",
  [HATCH.dots]: "M3 3h2M9 3h2M15 3h2M3 9h2M9 9h2M15 9h2",
};

function Swatch({ style }: { style: ClassStyle }) {
  return (
    <svg width="20" height="12" viewBox="0 0 20 12" className="swatch" aria-hidden>
      <rect width="20" height="12" fill={style.color} />
      <path
        d={LINES[HATCH[style.hatch]]}
        stroke="#0c1117"
        strokeOpacity="0.75"
        strokeWidth="1.6"
        fill="none"
      />
    </svg>
  );
}
