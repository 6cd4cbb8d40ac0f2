// What else is drawn: support regions by kind, forces, torques.

import { ChevronDown, ChevronRight } from "lucide-react";
import { useState } from "react";

import { regionAbout, regionName, shortly } from "../../lib/margins";
import { coincide, type Region, regionOf } from "../../lib/regions";
import { REGIONS, type RegionStyle } from "../../scene/palette";
import { useChannels } from "../../store/console";
import { setRegion, useView } from "../../store/view";
import "./overlays.css";

export function DrawingPanel() {
  const { forces, polygons, torqueColors } = useView();
  const [open, setOpen] = useState(false);
  const Arrow = open ? ChevronDown : ChevronRight;
  return (
    <section className="section drawing" aria-label="Drawing">
      <div className="drawing-row">
        <span className="region-head">
          <Toggle
            label="Polygons"
            title="Support polygons and center of mass"
            on={polygons}
            set={(on) => useView.setState({ polygons: on })}
          />
          <button
            type="button"
            className="button bare"
            aria-expanded={open}
            aria-label="Kinds of polygons"
            title="Which polygons are drawn"
            data-testid="regions-open"
            onClick={() => setOpen(!open)}
          >
            <Arrow size={14} aria-hidden />
          </button>
        </span>
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
      </div>
      {open && <RegionList />}
    </section>
  );
}

function RegionList() {
  const drawn = useView((s) => s.regions);
  const polygons = useView((s) => s.polygons);
  const stability = useChannels((c) => c.stability?.message ?? null);
  const regular = regionOf(stability, "regular");
  return (
    <ul className="region-list" aria-label="Kinds of polygons">
      {REGIONS.map((style) => {
        const region = regionOf(stability, style.key);
        const likeRegular = style.key !== "regular" && alike(region, regular);
        const on = polygons && drawn.includes(style.key);
        return (
          <li key={style.key}>
            <label className="check" title={regionAbout(style.key)}>
              <input
                type="checkbox"
                data-testid={`region-${style.key}`}
                checked={on}
                onChange={(event) => {
                  const wanted = event.target.checked;
                  // The first one chosen while none are drawn is the only one that was asked for.
                  if (wanted && !polygons) useView.setState({ polygons: true, regions: [] });
                  setRegion(style.key, wanted);
                }}
              />
              <LineSwatch style={style} />
              {regionName(style.key)}
              <span className="num of-rover" title={likeRegular ? "As the regular one" : undefined}>
                {likeRegular && "≈ "}
                {shortly(region)}
              </span>
            </label>
            {on && region.whyEmpty && <p className="quiet region-why">{region.whyEmpty}</p>}
          </li>
        );
      })}
    </ul>
  );
}

const alike = (a: Region, b: Region): boolean =>
  a.kind === "area" && b.kind === "area" && a.polygon !== null && b.polygon !== null
    ? coincide(a.polygon.polygon_m, b.polygon.polygon_m)
    : false;

/** A line as it is drawn, on the dark of the picture. */
function LineSwatch({ style }: { style: RegionStyle }) {
  return (
    <svg width="30" height="12" viewBox="0 0 30 12" className="swatch" aria-hidden>
      <rect width="30" height="12" fill="#1c232b" />
      <path
        d="M3 6h24"
        stroke={style.color}
        strokeWidth={style.width}
        strokeDasharray={style.stroke}
        fill="none"
      />
    </svg>
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
