// What the chosen pairs would see and what asking them costs, before they are asked.

import { Camera, ChevronDown, ChevronRight } from "lucide-react";
import { useState } from "react";

import { costOf, type Detail, type Region, type Wish } from "../../lib/cameras";
import { hiddenByLegs } from "../../lib/coverage";
import { fileSize, legLabel, percent } from "../../lib/format";
import { formatSpan } from "../../lib/time";
import { askPairs, chosenCameras, useCameras } from "../../store/cameras";
import { useConsole, useLive } from "../../store/console";
import { offerReimage } from "../../store/reimage";
import { chooseLeg, pickAt, useSelection } from "../../store/selection";
import { useTerrain } from "../../store/terrain";
import { currentVersion, useVersions } from "../../store/versions";
import { useView } from "../../store/view";
import { Segments } from "../../ui/Segments";

const DETAILS: [Detail, string, string][] = [
  ["quick", "Quick", "All images at a quarter of their size"],
  ["half", "Half", "All images at half their size"],
  ["near", "Fine near", "HazCams at full size, NavCams, which look far, at half"],
  ["full", "Full", "All images at full size"],
];

export function AskPairs() {
  const chosen = useCameras((s) => s.chosen);
  if (chosen.length === 0) {
    return (
      <p className="quiet small" data-testid="pairs-empty">
        Choose pairs: what they would see is drawn on the ground before they are asked.
      </p>
    );
  }
  return (
    <>
      <Coverage />
      <Wishes />
      <Request />
    </>
  );
}

function Coverage() {
  const { coverage, looking } = useCameras();
  const overlay = useView((s) => s.overlay);
  const legs = useConsole((s) => s.model?.legs) ?? [];
  const hidden = coverage
    ? hiddenByLegs(
        coverage,
        legs.map((l) => l.name),
      )
    : [];
  return (
    <div className="stack tight" data-testid="coverage" data-state={looking ? "loading" : "ready"}>
      <div className="row between">
        <span className="small">
          {coverage ? (
            <>
              {looking ? "Looking again" : "Would see"}{" "}
              <span className="num">{percent(coverage.seen_share)}</span> of the ground within reach
            </>
          ) : (
            <span className="quiet">Looking what they would see…</span>
          )}
        </span>
        {overlay !== "coverage" && (
          <button
            type="button"
            className="button bare"
            onClick={() => useView.setState({ overlay: "coverage" })}
          >
            Show
          </button>
        )}
      </div>
      {hidden.length > 0 && (
        <ul className="hidden-list" aria-label="Ground that legs hide">
          {hidden.map(({ by, area_m2, place_m }) => (
            <li key={by}>
              <button
                type="button"
                className="chip"
                data-testid={`hidden-${by}`}
                title={`Ground that ${legLabel(by)} hides: choose it, to lift ${legLabel(by)} and look again`}
                onClick={() => {
                  chooseLeg(by);
                  const { raster } = useTerrain.getState();
                  const hole = raster?.point(...place_m) ?? null;
                  pickAt(hole);
                  offerReimage(by, hole);
                }}
              >
                {legLabel(by)} hides <span className="num">{area_m2.toFixed(1)} m²</span>
              </button>
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}

const REGIONS: Record<Region, [label: string, title: string]> = {
  all: ["All seen", "All ground that the pairs see"],
  rover: ["Within 4 m", "Within 4 m of the rover"],
  pick: ["At the pick", "Within 1.5 m of the picked place"],
};

/** How fine, where, and what becomes of the map before: one line until it is opened. */
function Wishes() {
  const [open, setOpen] = useState(false);
  const wish = useCameras((s) => s.wish);
  const detail = DETAILS.find(([value]) => value === wish.detail)!;
  const Arrow = open ? ChevronDown : ChevronRight;
  const summary = [
    detail[1],
    REGIONS[wish.region][0].toLowerCase(),
    `${Math.round(100 * wish.resolution_m)} cm`,
    ...(wish.keepPrior ? [] : ["without the map before"]),
    ...(wish.anew ? ["anew"] : []),
  ].join(", ");
  return (
    <>
      <button
        type="button"
        className="wishes-head"
        aria-expanded={open}
        data-testid="wishes"
        title="How fine, where, and what becomes of the map before"
        onClick={() => setOpen(!open)}
      >
        <Arrow size={14} aria-hidden />
        <span className="small">{summary}</span>
      </button>
      {open && <WishFields />}
    </>
  );
}

function WishFields() {
  const wish = useCameras((s) => s.wish);
  const picked = useSelection((s) => s.pick !== null);
  const made = useVersions((s) => currentVersion(s)?.pairs?.length ?? 0);
  const set = (change: Partial<Wish>) =>
    useCameras.setState((s) => ({ wish: { ...s.wish, ...change } }));
  const regions = (Object.keys(REGIONS) as Region[]).filter((r) => r !== "pick" || picked);
  const cells_m = useVersions((s) => currentVersion(s)?.resolution_m ?? null);
  return (
    <>
      <Segments
        name="map-detail"
        label="Size of the images"
        choices={DETAILS}
        value={wish.detail}
        set={(detail) => set({ detail })}
        testId="detail"
      />
      <Segments
        name="map-region"
        label="Ground to map"
        choices={regions.map((r) => [r, ...REGIONS[r]])}
        value={wish.region === "pick" && !picked ? "all" : wish.region}
        set={(region) => set({ region })}
        testId="region"
      />
      <div className="row between">
        <label
          className="check small"
          title="Where no pair sees ground, it stays as in the map before"
        >
          <input
            type="checkbox"
            data-testid="keep-prior"
            checked={wish.keepPrior}
            onChange={(event) => set({ keepPrior: event.target.checked })}
          />
          Keep the map before
        </label>
        <label className="row small quiet">
          Cells
          <select
            className="cells"
            data-testid="cells"
            value={wish.resolution_m}
            onChange={(event) => {
              const resolution_m = Number(event.target.value);
              // What was seen so far can only be gone on from at its own distance of nodes.
              set({ resolution_m, anew: made > 0 && resolution_m !== cells_m });
            }}
          >
            <option value={0.05}>5 cm</option>
            <option value={0.1}>10 cm</option>
          </select>
        </label>
      </div>
      {made > 0 && (
        <label className="check small" title="Forgets what cameras saw so far">
          <input
            type="checkbox"
            data-testid="anew"
            checked={wish.anew}
            onChange={(event) => set({ anew: event.target.checked })}
          />
          Begin anew, without what was seen so far
        </label>
      )}
    </>
  );
}

/** Work of the ground for one pair at full size (s): matching goes by the area. */
const WORK_S = 5;

function Request() {
  const state = useCameras();
  const connected = useConsole((s) => s.connection === "open");
  const known = useConsole((s) => s.stream.live.rover !== null);
  const cameras = chosenCameras(state);
  const rate = useLive((c) => c.link?.message.config.down?.rate_bps ?? null) ?? state.rate_bps;
  const cost = costOf(cameras, state.wish.detail, rate);
  const area = cost.bytes / Math.max(1, ...cameras.map((c) => c.raw_bytes));
  const why = !connected ? "No connection to the ground" : !known ? "No telemetry yet" : null;
  const n = cameras.length;
  return (
    <div className="stack tight">
      <p className="small quiet" data-testid="cost">
        <span className="num">{fileSize(cost.bytes)}</span>
        {cost.link_s === null ? (
          ", no limit of the link set"
        ) : (
          <>
            , <span className="num">{formatSpan(cost.link_s)}</span> over the link
          </>
        )}
        , about <span className="num">{Math.max(1, Math.round(WORK_S * area))} s</span> of work
      </p>
      <button
        type="button"
        className="button primary"
        data-testid="ask-pairs"
        disabled={why !== null}
        title={why ?? "A new version of the map is made of what they see"}
        onClick={() => void askPairs()}
      >
        <Camera size={14} aria-hidden />
        Ask {n === 1 ? "1 pair" : `${n} pairs`}
      </button>
    </div>
  );
}
