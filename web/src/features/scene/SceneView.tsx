// The canvas, what is drawn beside it (scale, north, age), and the pointer.

import { Compass, Maximize2, Mountain } from "lucide-react";
import { useEffect, useRef, useState } from "react";

import { metres } from "../../lib/format";
import { formatSpan } from "../../lib/time";
import { bind } from "../../scene/bind";
import { bestQuality, Viewer } from "../../scene/viewer";
import { useConsole } from "../../store/console";
import { startFollowing } from "../../store/follow";
import { useFreshness } from "../../store/freshness";
import { usePlan } from "../../store/plan";
import { chooseLeg, hoverAt, pickAt, useSelection } from "../../store/selection";
import { useTerrain } from "../../store/terrain";
import { aim, nextView, useView } from "../../store/view";
import { installHook } from "./debugHook";
import { FollowNote, placeNote } from "./FollowNote";
import "./scene.css";

/** Widths that panels cover at the sides (px): the rover is shown in the free middle. */
interface Props {
  left: number;
  right: number;
}

export function SceneView({ left, right }: Props) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const cues = useRef<SVGSVGElement>(null);
  const note = useRef<HTMLDivElement>(null);
  const viewer = useRef<Viewer | null>(null);
  const [missing, setMissing] = useState(false);

  useEffect(() => {
    const element = canvas.current;
    const quality = bestQuality();
    if (!element || !quality) {
      setMissing(true);
      return;
    }
    const made = new Viewer(element, quality);
    viewer.current = made;
    made.onFrame = () => {
      drawCues(cues.current, made);
      placeNote(note.current, made);
    };
    const unbind = bind(made);
    const unhook = installHook(made);
    const unpoint = followPointer(element, made);
    const unfollow = startFollowing();
    return () => {
      unfollow();
      unpoint();
      unhook();
      unbind();
      made.dispose();
      viewer.current = null;
    };
  }, []);

  useEffect(() => {
    const element = canvas.current?.parentElement;
    if (!element) return;
    const fit = () =>
      viewer.current?.resize(element.clientWidth, element.clientHeight, left, right);
    const observer = new ResizeObserver(fit);
    observer.observe(element);
    fit();
    return () => observer.disconnect();
  }, [left, right]);

  return (
    <div className="scene">
      <canvas
        ref={canvas}
        className="scene-canvas"
        data-testid="canvas"
        aria-label="Rover and ground in three dimensions. Keys 1 to 6 choose a leg, arrow keys move the pick."
        role="img"
      />
      {missing ? <NoWebGl /> : <SceneNotes left={left} right={right} cues={cues} />}
      <MapNote left={left} />
      <FollowNote note={note} viewer={viewer} />
    </div>
  );
}

function NoWebGl() {
  return (
    <div className="scene-missing" data-testid="no-webgl">
      <strong>The 3-D picture needs WebGL 2, which this browser does not offer</strong>
      <p className="quiet">
        Telemetry, plans, commands and E-stop work without it. Places can be picked with the arrow
        keys: choose a leg first.
      </p>
    </div>
  );
}

/** Which map is shown, and that what is on it was made up where it was. */
function MapNote({ left }: { left: number }) {
  const version = useTerrain((s) => s.version);
  const [width, height] = version?.size.map((n) => (n - 1) * version.resolution_m) ?? [0, 0];
  const facts = version
    ? `${version.source}: ${width!.toFixed(0)} × ${height!.toFixed(0)} m, a node each ${metres(version.resolution_m)}`
    : "No map has come yet";
  return (
    <div className="scene-map small" style={{ left: left + 28 }}>
      <span className="scene-map-name" title={facts} data-testid="map-name">
        {version ? version.source : "No map"}
      </span>
      {version?.synthetic_detail && (
        <span
          className="scene-tag"
          data-testid="map-synthetic"
          title="Detail of this ground was generated, not measured"
        >
          synthetic detail
        </span>
      )}
      <button
        type="button"
        className="button bare"
        data-testid="import-open"
        onClick={() => useView.setState({ importOpen: true })}
      >
        <Mountain size={14} aria-hidden /> New map
      </button>
    </div>
  );
}

function SceneNotes({
  left,
  right,
  cues,
}: {
  left: number;
  right: number;
  cues: React.RefObject<SVGSVGElement | null>;
}) {
  return (
    <>
      <div className="scene-cues" style={{ right: right + 16 }}>
        <span className="scene-buttons">
          <button
            type="button"
            className="button icon"
            aria-label="Next view"
            title="Next view: side, top, leg (v)"
            onClick={nextView}
          >
            <Compass size={16} />
          </button>
          <button
            type="button"
            className="button icon"
            aria-label="Fit the rover"
            title="Fit the rover (f)"
            onClick={() => aim("iso")}
          >
            <Maximize2 size={16} />
          </button>
        </span>
        <svg ref={cues} width="190" height="40" viewBox="0 0 190 40" aria-hidden>
          <g data-cue="north" transform="translate(168 20)">
            <circle r="15" className="cue-ring" />
            <g data-cue="needle">
              <path d="M0 -11L4.5 6 0 3 -4.5 6z" className="cue-needle" />
            </g>
            <text y="-1" className="cue-n" data-cue="n">
              N
            </text>
          </g>
          <g data-cue="scale">
            <path className="cue-line" d="" />
            <text className="cue-text" y="16" />
          </g>
        </svg>
      </div>
      <Overhead />
      <Poses left={left} />
    </>
  );
}

/** Says what the picture lacks or how old it is. */
function Overhead() {
  const { age_s, stale } = useFreshness();
  const terrain = useTerrain((s) => s.state);
  const progress = useTerrain((s) => s.progress);
  const terrainFailure = useTerrain((s) => s.failure);
  const failure = useConsole((s) => s.failure);
  const loaded = useConsole((s) => s.model !== null);
  const replaying = useConsole((s) => s.stream.replayState !== null);
  let note: React.ReactNode = null;
  if (failure) note = `The rover's model could not be loaded. ${failure}`;
  else if (!loaded) note = "Loading the rover's model…";
  else if (terrain === "failed") note = `The map could not be loaded. ${terrainFailure ?? ""}`;
  else if (terrain === "loading") note = `Loading the map: ${Math.round(progress * 100)} %`;
  else if (age_s === null && replaying) note = "By this time of the log no telemetry had come.";
  else if (age_s === null) note = "No telemetry has come yet.";
  else if (stale) note = `Shown as it was ${formatSpan(age_s)} ago`;
  return note === null ? null : (
    <div className="scene-note panel" role="status">
      {note}
    </div>
  );
}

/** Names the poses that are shown beside each other: past, present guess, plan. */
function Poses({ left }: { left: number }) {
  const planned = usePlan((s) => (s.plan?.waypoints.length ?? 0) > 0);
  const predicted = useView((s) => s.predicted);
  const { age_s } = useFreshness();
  if (!planned && !predicted) return null;
  return (
    <ul className="scene-poses small" style={{ left: left + 28 }}>
      <li>
        <i className="pose-reported" aria-hidden />
        reported {age_s === null ? "" : `${formatSpan(age_s)} ago`}
      </li>
      {predicted && (
        <li data-testid="predicted">
          <i className="pose-predicted" aria-hidden />
          predicted now
        </li>
      )}
      {planned && (
        <li>
          <i className="pose-planned" aria-hidden />
          planned
        </li>
      )}
    </ul>
  );
}

const NICE_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

/** Scale bar and north arrow follow the camera; written to the SVG without a render of React. */
function drawCues(svg: SVGSVGElement | null, viewer: Viewer): void {
  if (!svg) return;
  const perMetre = viewer.pixelsPerMetre();
  const length = NICE_M.findLast((m) => m * perMetre <= 120) ?? 0.1;
  const px = length * perMetre;
  const start = 140 - px;
  const scale = svg.querySelector("[data-cue=scale]")!;
  scale.querySelector("path")!.setAttribute("d", `M${start} 22v6h${px}v-6`);
  const text = scale.querySelector("text")!;
  text.setAttribute("x", String(start + px / 2));
  text.textContent = length >= 1 ? `${length} m` : `${length * 100} cm`;
  const turn = (-viewer.bearing() * 180) / Math.PI;
  svg.querySelector("[data-cue=needle]")!.setAttribute("transform", `rotate(${turn})`);
}

const CLICK_PX = 4;

/** Press without dragging picks; moving shows the cell below. */
function followPointer(canvas: HTMLCanvasElement, viewer: Viewer): () => void {
  let down: [number, number] | null = null;
  let frame = 0;
  const place = (event: PointerEvent): [number, number] => [event.offsetX, event.offsetY];
  const onDown = (event: PointerEvent) => {
    if (event.button === 0) down = place(event);
  };
  const onUp = (event: PointerEvent) => {
    const start = down;
    down = null;
    if (!start || event.button !== 0) return;
    const [x, y] = place(event);
    if (Math.hypot(x - start[0], y - start[1]) > CLICK_PX) return;
    const picked = viewer.pick(x, y, useSelection.getState().leg);
    if (picked?.kind === "leg") chooseLeg(picked.leg);
    else if (picked) pickAt(picked.point);
  };
  const onMove = (event: PointerEvent) => {
    if (frame !== 0 || event.buttons !== 0) return;
    const [x, y] = place(event);
    frame = requestAnimationFrame(() => {
      frame = 0;
      hoverAt(viewer.hover(x, y));
    });
  };
  const onLeave = () => {
    cancelAnimationFrame(frame);
    frame = 0;
    hoverAt(null);
  };
  canvas.addEventListener("pointerdown", onDown);
  canvas.addEventListener("pointerup", onUp);
  canvas.addEventListener("pointermove", onMove);
  canvas.addEventListener("pointerleave", onLeave);
  return () => {
    cancelAnimationFrame(frame);
    canvas.removeEventListener("pointerdown", onDown);
    canvas.removeEventListener("pointerup", onUp);
    canvas.removeEventListener("pointermove", onMove);
    canvas.removeEventListener("pointerleave", onLeave);
  };
}
