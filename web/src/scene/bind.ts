// Ties the stores to the viewer: what changes there is shown here.

import type { RasterHeader } from "../api/tiles";
import type {
  CommandRecord,
  PlanAnalysis,
  RoverState,
  RoverTelemetry,
  StabilityDerived,
  Vec2,
  Vec3,
} from "../api/types";
import { type PlanPose, poseAt } from "../lib/pose";
import { type RegionKey, regionOf } from "../lib/regions";
import { predictedPose } from "../lib/step";
import { COVERAGE } from "../lib/coverage";
import { stylesOf } from "../lib/mapLayers";
import { useCameras } from "../store/cameras";
import { useConsole } from "../store/console";
import { useDrapes } from "../store/drapes";
import { useEnergy } from "../store/energy";
import { freshnessOf } from "../store/freshness";
import { useFollow } from "../store/follow";
import { shownNow } from "../store/now";
import { useMapLayer } from "../store/mapLayer";
import { usePlan } from "../store/plan";
import { useGhost } from "../store/posture";
import { useReach } from "../store/reach";
import { useSelection } from "../store/selection";
import { type Channels, shown } from "../store/streamState";
import { useTerrain } from "../store/terrain";
import { useView } from "../store/view";
import { PLANNED, REACHABILITY, TRAVERSABILITY } from "./palette";
import type { Viewer } from "./viewer";

const EDGE_COLORS = { good: "#56f000", low: "#ffb302", out: "#ff3838" };
const MOVED = 2e-4;
const REACH_STYLES = [...REACHABILITY, ...PLANNED];

type Unbind = () => void;

/** Shows the stores' present content and follows them until unbound. */
export function bind(viewer: Viewer): Unbind {
  const stops = [
    bindRover(viewer),
    bindTerrain(viewer),
    bindDrapes(viewer),
    bindSelection(viewer),
    bindPlan(viewer),
    bindFollow(viewer),
    bindEnergy(viewer),
    bindCamera(viewer),
  ];
  return () => stops.forEach((stop) => stop());
}

function bindRover(viewer: Viewer): Unbind {
  let before: Channels | null = null;
  let posed: RoverTelemetry | null = null;
  let robotOf: string | null = null;
  let drawn = "";
  let stale: boolean | null = null;

  const update = () => {
    const state = useConsole.getState();
    const { model, urdf } = state;
    if (model && urdf !== null && robotOf !== model.model_hash) {
      robotOf = model.model_hash;
      try {
        viewer.setRobot(model, urdf);
      } catch (error) {
        useConsole.setState({ failure: error instanceof Error ? error.message : String(error) });
      }
      viewer.robot?.highlight(useSelection.getState().leg);
      posed = null;
    }
    const channels = shown(state.stream);
    const rover = channels.rover?.message ?? null;
    if (rover && (!posed || moved(posed, rover))) {
      posed = rover;
      viewer.setState(rover.state);
      // Where the base is decides where the planned leg starts from.
      showGhost(viewer);
    }
    const view = useView.getState();
    const raster = useTerrain.getState().raster;
    const { forces, polygons, regions, torqueColors } = view;
    const look = `${forces}${polygons}${regions.join()}${torqueColors}${raster?.z_max_m}${robotOf}`;
    if (model && (channels !== before || look !== drawn)) {
      const changed = look !== drawn || stanceChanged(before, channels);
      before = channels;
      drawn = look;
      if (changed)
        showStance(viewer, channels, model.margin_m, (model.mass_kg * model.gravity_m_s2) / 6);
    }
    showPredicted(viewer, channels);
  };

  const updateStale = () => {
    const now = freshnessOf(useConsole.getState(), shownNow()).stale;
    if (now !== stale) {
      stale = now;
      viewer.robot?.setStale(now);
      viewer.invalidate();
    }
  };

  const stops = [
    useConsole.subscribe(() => {
      update();
      updateStale();
    }),
    useView.subscribe(update),
    useTerrain.subscribe(update),
  ];
  const watch = setInterval(updateStale, 500);
  update();
  updateStale();
  return () => {
    stops.forEach((stop) => stop());
    clearInterval(watch);
  };
}

function far(a: number[], b: number[]): boolean {
  return a.length !== b.length || a.some((v, i) => Math.abs(v - b[i]!) > MOVED);
}

function moved(a: RoverTelemetry, b: RoverTelemetry): boolean {
  if (far(a.state.base.position_m, b.state.base.position_m)) return true;
  if (far(a.state.base.orientation_xyzw, b.state.base.orientation_xyzw)) return true;
  const spin = (t: RoverTelemetry) => Object.values(t.state.wheels_rad ?? {});
  if (far(spin(a), spin(b))) return true;
  return Object.entries(b.state.joints_rad).some(([leg, q]) =>
    far(a.state.joints_rad[leg] ?? [], q),
  );
}

const outlineOf = (stability: StabilityDerived, key: RegionKey): number[] =>
  regionOf(stability, key).polygon?.polygon_m.flat() ?? [];

/** Telemetry comes ten times a second; most of it says what the last frame said. */
function stanceChanged(before: Channels | null, now: Channels): boolean {
  const a = before?.stability?.message;
  const b = now.stability?.message;
  if (!a || !b) return a !== b || before?.rover !== now.rover;
  const force = (c: Channels) => Object.values(c.rover?.message.wheel_forces_n ?? {}).flat();
  const forcesMoved = force(now).some((v, i) => Math.abs(v - (force(before!)[i] ?? 0)) > 2);
  return (
    forcesMoved ||
    far(a.com_m, b.com_m) ||
    useView.getState().regions.some((key) => far(outlineOf(a, key), outlineOf(b, key))) ||
    Math.abs(a.torque_ratio - b.torque_ratio) > 0.01
  );
}

function showStance(viewer: Viewer, channels: Channels, needed_m: number, unit_n: number): void {
  const view = useView.getState();
  const stability = channels.stability?.message ?? null;
  const margin = stability?.regular?.margin_m ?? -1;
  const edge = margin < 0 ? "out" : margin < needed_m ? "low" : "good";
  // The store's raster, for the viewer's may still be that of the map before.
  const { raster } = useTerrain.getState();
  const polygons = view.polygons ? stability : null;
  viewer.stance.setPolygons(polygons, view.regions, raster, EDGE_COLORS[edge]);
  viewer.stance.setForces(view.forces ? (channels.rover?.message ?? null) : null, unit_n);
  viewer.robot?.setTorques(view.torqueColors ? (stability?.torque_ratios ?? null) : null);
  viewer.invalidate();
}

/** Where the commands under way should have brought the rover by now. */
function showPredicted(viewer: Viewer, channels: Channels): void {
  if (!viewer.robot) return;
  const replaying = useConsole.getState().stream.replayState !== null;
  const now = shownNow();
  const reported = channels.rover?.message.state ?? null;
  const { plan } = usePlan.getState();
  const guess = (c: CommandRecord) => predictedPose(c, now, plan, reported);
  const predicted = replaying ? null : channels.commands.map(guess).findLast((p) => p !== null);
  const pose = predicted && reported && apart(predicted, reported) ? predicted : null;
  const shownBefore = useView.getState().predicted;
  if (pose === null && !shownBefore) return;
  if (shownBefore !== (pose !== null)) useView.setState({ predicted: pose !== null });
  viewer.robot.setPredicted(pose);
  viewer.invalidate();
}

/** Largest difference between a predicted and the reported pose that is not drawn (rad, m). */
const NEAR_RAD = 0.01;
const NEAR_M = 0.005;

function apart({ leg, joints_rad, stance }: PlanPose, reported: RoverState): boolean {
  const further = (a: number[], b: number[], by: number) =>
    a.some((v, i) => Math.abs(v - (b[i] ?? v)) > by);
  if (stance) return further(stance.base.position_m, reported.base.position_m, NEAR_M);
  return further(reported.joints_rad[leg] ?? [], joints_rad, NEAR_RAD);
}

function bindTerrain(viewer: Viewer): Unbind {
  let raster: unknown = null;
  const overlay = () => {
    const terrain = useTerrain.getState();
    const { overlay: kind } = useView.getState();
    const { grid } = useReach.getState();
    if (terrain.raster !== raster) {
      raster = terrain.raster;
      viewer.setRaster(terrain.raster);
      showPick(viewer);
      showTrace(viewer);
      showGhost(viewer);
    }
    if (kind === "traversability" && terrain.raster && terrain.classes) {
      const { shape } = terrain.raster;
      return { shape, classes: terrain.classes, styles: TRAVERSABILITY };
    }
    if (kind === "coverage") {
      const { raster: seen } = useCameras.getState();
      return seen && { shape: seen, classes: seen.classes, styles: COVERAGE };
    }
    if (kind === "map") {
      const { shown: laid } = useMapLayer.getState();
      if (!laid || laid.of !== terrain.version?.version) return null;
      const styles = stylesOf(laid.layer, terrain.version);
      return { shape: laid.shape, classes: laid.classes, styles };
    }
    if (kind === "reachability" && grid) {
      const circle = reachCircle(grid.header, useReach.getState().leg);
      return { shape: grid.header, classes: grid.classes, styles: REACH_STYLES, circle };
    }
    return null;
  };
  let last: Uint8Array | null = null;
  const update = () => {
    const next = overlay();
    if ((next?.classes ?? null) === last) return;
    last = next?.classes ?? null;
    viewer.setOverlay(next);
  };
  const stops = [useTerrain, useReach, useView, useCameras, useMapLayer].map((store) =>
    (store.subscribe as (listener: () => void) => Unbind)(update),
  );
  update();
  return () => stops.forEach((stop) => stop());
}

/** Pictures over the ground: that of the cameras where it is asked for, and an imported raster. */
function bindDrapes(viewer: Viewer): Unbind {
  const update = () => {
    const { picture, raster, opacity } = useDrapes.getState();
    const wanted = useView.getState().overlay === "picture";
    const { version } = useTerrain.getState();
    viewer.setPicture(wanted && picture?.of === version?.version ? picture : null);
    viewer.setImported(raster, opacity);
  };
  update();
  const stops = [useDrapes, useView, useTerrain].map((store) =>
    (store.subscribe as (listener: () => void) => Unbind)(update),
  );
  return () => stops.forEach((stop) => stop());
}

/** A leg answers for the circle of its length around its hip; the hip is the middle of its grid. */
function reachCircle(header: RasterHeader, leg: string | null): [number, number, number] {
  const { origin_m, size, resolution_m } = header;
  const half = size.map((n) => ((n - 1) / 2) * resolution_m) as Vec2;
  const model = useConsole.getState().model?.legs.find((l) => l.name === leg);
  const radius = Math.min(model?.reach_m ?? Infinity, Math.max(...half));
  return [origin_m[0] + half[0], origin_m[1] + half[1], radius];
}

function bindSelection(viewer: Viewer): Unbind {
  const update = () => {
    showPick(viewer);
    viewer.robot?.highlight(useSelection.getState().leg);
    viewer.invalidate();
  };
  update();
  return useSelection.subscribe((now, before) => {
    if (now.pick !== before.pick || now.leg !== before.leg) update();
    if (now.leg !== null && now.leg !== before.leg) viewer.reveal(now.leg);
  });
}

function showPick(viewer: Viewer): void {
  const { leg, pick } = useSelection.getState();
  viewer.marks.setPick(pick, viewer.raster, wheelRadius(leg));
}

function wheelRadius(leg: string | null | undefined): number {
  const legs = useConsole.getState().model?.legs;
  return legs?.find((l) => l.name === leg)?.wheel_radius_m ?? 0.2;
}

const reportedState = () => shown(useConsole.getState().stream).rover?.message.state ?? null;

function bindPlan(viewer: Viewer): Unbind {
  const update = () => {
    showTrace(viewer);
    showGhost(viewer);
  };
  update();
  const stops = [
    useGhost.subscribe(() => showGhost(viewer)),
    usePlan.subscribe((now, before) => {
      if (now.plan !== before.plan) update();
      else if (now.at_s !== before.at_s) showGhost(viewer);
    }),
  ];
  return () => stops.forEach((stop) => stop());
}

const TRACE_POINTS = 80;

function showTrace(viewer: Viewer): void {
  const { plan } = usePlan.getState();
  viewer.marks.setTrace(plan ? wayOf(viewer, plan) : [], plan && footfallOf(plan));
  viewer.marks.setNearest(plan?.nearest_m ?? null, viewer.raster, wheelRadius(plan?.leg));
  viewer.invalidate();
}

/** The way of the wheel's center through the air. */
function wayOf(viewer: Viewer, plan: PlanAnalysis): Vec3[] {
  if (plan.waypoints.length < 2) return [];
  const length = plan.waypoints.at(-1)!.time_s;
  const reported = reportedState();
  const path = Array.from({ length: TRACE_POINTS + 1 }, (_, i) =>
    poseAt(plan.leg, plan.waypoints, (i / TRACE_POINTS) * length, reported),
  );
  return viewer.robot?.trace(path) ?? [];
}

function footfallOf({ leg, footfall }: PlanAnalysis) {
  if (!footfall) return null;
  const radius_m = wheelRadius(leg);
  const { normal } = footfall;
  return { at: below(footfall.wheel.position_m, normal, radius_m), normal, radius_m };
}

/** The ground below a wheel; a leaning wheel touches it with its rim, a hand's breadth aside. */
function below(center: Vec3, normal: Vec3, radius_m: number): Vec3 {
  return center.map((v, i) => v - radius_m * normal[i]!) as Vec3;
}

/**
 * A posture that is looked at, else the end of what follows the pointer, else where the preview of the
 * plan stands.
 */
function showGhost(viewer: Viewer): void {
  const { plan, at_s } = usePlan.getState();
  const follow = useFollow.getState();
  const looked = useGhost.getState();
  if (looked.end) {
    const joints_rad = looked.end.joints_rad[looked.leg] ?? [];
    viewer.robot?.setSoft(true);
    viewer.robot?.setGhost({ leg: looked.leg, joints_rad, stance: looked.end });
    viewer.invalidate();
    return;
  }
  const [of, at] = follow.shown ? [follow.shown.answer, Infinity] : [plan, at_s];
  // A plan that the final check refused can be looked at, once it was asked for.
  const drawn = of !== null && of.waypoints.length > 0 && (of === plan || of.outcome === "found");
  const pose = drawn ? poseAt(of.leg, of.waypoints, at, reportedState()) : null;
  viewer.robot?.setSoft(follow.active || (plan?.waypoints.length ?? 0) > 0);
  viewer.robot?.setGhost(pose, follow.shown !== null && follow.late);
  viewer.invalidate();
}

function bindFollow(viewer: Viewer): Unbind {
  const update = () => {
    const { shown: last, late } = useFollow.getState();
    const answer = last?.answer;
    const found = answer?.outcome === "found";
    const mark = answer && {
      way: found ? wayOf(viewer, answer) : [],
      footfall: found ? footfallOf(answer) : null,
      refused: found ? null : last.target_m,
      crossed: answer.outcome !== "deadline",
      nearest: answer.nearest_m ?? null,
      radius_m: wheelRadius(answer.leg),
      dim: late,
    };
    viewer.marks.setFollow(mark ?? null, viewer.raster);
    showGhost(viewer);
  };
  return useFollow.subscribe(update);
}

function bindEnergy(viewer: Viewer): Unbind {
  let surface: unknown = null;
  let raster: unknown = null;
  const update = () => {
    const next = useEnergy.getState().surface;
    const ground = useTerrain.getState().raster;
    if (next === surface && (next === null || ground === raster)) return;
    surface = next;
    raster = ground;
    viewer.energy.set(next, ground);
    viewer.invalidate();
  };
  update();
  const stops = [useEnergy.subscribe(update), useTerrain.subscribe(update)];
  return () => stops.forEach((stop) => stop());
}

function bindCamera(viewer: Viewer): Unbind {
  return useView.subscribe((now, before) => {
    if (now.aimed !== before.aimed) viewer.aim(now.camera, useSelection.getState().leg);
  });
}
