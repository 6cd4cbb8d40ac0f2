// The 3-D scene: one imperative object that is told what to show and renders when that changes.

import {
  AmbientLight,
  Color,
  DirectionalLight,
  Fog,
  HemisphereLight,
  PCFShadowMap,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";

import type { RoverModel, RoverState, Vec3 } from "../api/types";
import type { CameraView } from "../store/view";
import { CameraRig } from "./cameraRig";
import { EnergyView } from "./energyView";
import { type DrapeImage, Ground, type OverlayRaster } from "./ground";
import { pickGround, type Ray } from "./gridPick";
import type { HeightRaster } from "./heightRaster";
import { pickLeg } from "./legPick";
import { Marks } from "./marks";
import { placesTowards } from "./reveal";
import { RobotView } from "./robotView";
import { StanceView } from "./stance";

export type Quality = "low" | "high";
export type Picked = { kind: "leg"; leg: string } | { kind: "ground"; point: Vec3 };

const SKY = "#0b1016";
/** Data does not redraw more often than this; the operator's own hand does. */
const DATA_FRAME_MS = 66;
const JUMP_M = 0.5;

export class Viewer {
  readonly stance = new StanceView();
  readonly energy = new EnergyView();
  readonly marks = new Marks();
  robot: RobotView | null = null;
  raster: HeightRaster | null = null;
  framesRendered = 0;
  /** Called after each frame, for what is drawn beside the canvas. */
  onFrame: () => void = () => {};

  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly rig: CameraRig;
  private readonly ground: Ground;
  private readonly sun = new DirectionalLight(0xfff3e0, 2.7);
  private readonly raycaster = new Raycaster();
  private state: RoverState | null = null;
  private frame = 0;
  private timer = 0;
  private last = 0;
  private fitted = false;
  /** Widths at the sides that panels cover (px). */
  private covered = { left: 0, right: 0 };

  constructor(
    readonly canvas: HTMLCanvasElement,
    readonly quality: Quality,
  ) {
    const high = quality === "high";
    this.renderer = new WebGLRenderer({
      canvas,
      antialias: high,
      powerPreference: "high-performance",
    });
    this.renderer.setPixelRatio(high ? Math.min(devicePixelRatio, 2) : 1);
    this.renderer.shadowMap.enabled = high;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.rig = new CameraRig(canvas, () => this.invalidate(true));
    this.ground = new Ground(high ? 512 : 112);
    this.scene.background = new Color(SKY);
    this.scene.fog = new Fog(SKY, 40, 90);
    this.light(high);
    canvas.addEventListener("webglcontextrestored", this.onRestored);
    this.scene.add(this.ground.group, this.energy.group, this.stance.group, this.marks.group);
  }

  /** Renders soon: at once for the operator's hand, at most 15 times a second for data. */
  invalidate(by_hand = false): void {
    if (this.frame !== 0) return;
    const wait =
      by_hand && this.quality === "high" ? 0 : this.last + DATA_FRAME_MS - performance.now();
    if (wait <= 0) {
      clearTimeout(this.timer);
      this.timer = 0;
      this.frame = requestAnimationFrame((now) => this.render(now));
    } else if (this.timer === 0) {
      this.timer = window.setTimeout(() => {
        this.timer = 0;
        this.invalidate(true);
      }, wait);
    }
  }

  resize(width: number, height: number, left: number, right: number): void {
    if (width < 1 || height < 1) return;
    this.renderer.setSize(width, height, false);
    this.covered = { left, right };
    this.rig.resize(width, height, left, right);
    this.invalidate(true);
  }

  setRaster(raster: HeightRaster | null): void {
    this.raster = raster;
    if (raster) this.ground.setRaster(raster);
    else this.ground.clear();
    this.fitted = false;
    this.fitOnce();
    this.invalidate();
  }

  setOverlay(overlay: OverlayRaster | null): void {
    this.ground.setOverlay(overlay);
    this.invalidate();
  }

  setPicture(image: DrapeImage | null): void {
    this.ground.setPicture(image);
    this.invalidate();
  }

  setImported(image: DrapeImage | null, opacity: number): void {
    this.ground.setImported(image, opacity);
    this.invalidate();
  }

  setRobot(model: RoverModel, urdf: string): void {
    if (this.robot) {
      this.scene.remove(this.robot.group);
      this.robot.dispose();
    }
    this.robot = new RobotView(model, urdf, this.quality === "low");
    this.robot.dressPayloads();
    this.scene.add(this.robot.group);
    if (this.state) this.setState(this.state);
    this.invalidate();
  }

  setState(state: RoverState): void {
    // Legs carry the rover by less between two frames: it was set down elsewhere.
    if (this.state && distance(this.state.base.position_m, state.base.position_m) > JUMP_M) {
      this.fitted = false;
    }
    this.state = state;
    this.robot?.setState(state);
    const [x, y, z] = state.base.position_m;
    this.sun.target.position.set(x, y, z);
    this.sun.position.set(x - 14, y + 9, z + 9);
    this.fitOnce();
    this.invalidate();
  }

  /** Aims the camera at the rover: from the side, from above, or along the chosen leg. */
  aim(view: CameraView, leg: string | null, at_once = false): void {
    const base = this.state?.base.position_m ?? [0, 0, 0];
    const ground = this.raster?.heightAt(base[0], base[1]);
    const z = ground === undefined || Number.isNaN(ground) ? base[2] - 1.5 : ground;
    const size = this.reach();
    const wheel = leg === null ? null : (this.robot?.wheel(leg) ?? null);
    if (view === "leg" && wheel) {
      const out = new Vector3(wheel[0] - base[0], wheel[1] - base[1], 0).normalize();
      const side: Vec3 = [out.x - 0.9 * out.y, out.y + 0.9 * out.x, 0.75];
      this.rig.aim(
        [0.7 * wheel[0] + 0.3 * base[0], 0.7 * wheel[1] + 0.3 * base[1], wheel[2] + 0.2],
        side,
        1.6 * size,
        at_once,
      );
    } else if (view === "top") {
      this.rig.aim([base[0], base[1], z], [0, -0.002, 1], 2.7 * size, at_once);
    } else {
      this.rig.aim([base[0], base[1], z + 0.17 * size], [-0.16, -1, 0.72], 2.75 * size, at_once);
    }
    this.invalidate(true);
  }

  /** Turns the camera as far as a leg that cannot be seen asks for. */
  reveal(leg: string): void {
    const wheel = this.robot?.wheel(leg);
    if (!wheel || !this.robot || !this.state) return;
    const on = this.project(...wheel);
    const { clientWidth, clientHeight } = this.canvas;
    const outside =
      !on ||
      on.x < this.covered.left ||
      on.x > clientWidth - this.covered.right ||
      on.y < 0 ||
      on.y > clientHeight;
    if (outside) this.aim("iso", null, true);
    const { position } = this.rig.camera;
    const places = placesTowards(position, this.rig.controls.target, new Vector3(...wheel));
    const place = places.find((p) => !this.robot!.hides(leg, p)) ?? places.at(-1);
    if (place && place.distanceTo(position) > 1e-6) this.rig.moveTo(place);
    this.invalidate(true);
  }

  /** What is under a place of the canvas (px); the chosen leg does not hide the ground behind it. */
  pick(x: number, y: number, chosen: string | null): Picked | null {
    const ray = this.ray(x, y);
    const point = this.raster && pickGround(this.raster, ray);
    const leg = this.robot && this.state ? pickLeg(this.robot.legShapes(), ray) : null;
    // The direction is a unit vector, so that lengths along it are metres.
    const ground = point ? distance(point, ray.origin) : Infinity;
    if (leg && leg.t < ground && !(point && leg.leg === chosen))
      return { kind: "leg", leg: leg.leg };
    return point ? { kind: "ground", point } : null;
  }

  hover(x: number, y: number): Vec3 | null {
    return this.raster && pickGround(this.raster, this.ray(x, y));
  }

  /** Where a point of the world is on the canvas (px), or null behind the camera. */
  project(x: number, y: number, z: number): { x: number; y: number } | null {
    this.rig.camera.updateMatrixWorld();
    const p = new Vector3(x, y, z).project(this.rig.camera);
    if (p.z > 1) return null;
    const { clientWidth, clientHeight } = this.canvas;
    return { x: ((p.x + 1) / 2) * clientWidth, y: ((1 - p.y) / 2) * clientHeight };
  }

  /** Size of the canvas and what panels cover of it at the sides (px). */
  free(): { left: number; right: number; width: number; height: number } {
    const { clientWidth, clientHeight } = this.canvas;
    return { ...this.covered, width: clientWidth, height: clientHeight };
  }

  pixelsPerMetre(): number {
    return this.rig.pixelsPerMetre(this.canvas.clientHeight);
  }

  bearing(): number {
    return this.rig.bearing();
  }

  private readonly onRestored = () => this.invalidate(true);

  dispose(): void {
    this.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    cancelAnimationFrame(this.frame);
    clearTimeout(this.timer);
    this.rig.dispose();
    this.ground.dispose();
    this.energy.dispose();
    this.stance.dispose();
    this.marks.dispose();
    this.robot?.dispose();
    this.renderer.dispose();
  }

  private light(shadows: boolean): void {
    const sun = this.sun;
    sun.castShadow = shadows;
    sun.shadow.mapSize.set(2048, 2048);
    const side = 9;
    Object.assign(sun.shadow.camera, {
      left: -side,
      right: side,
      top: side,
      bottom: -side,
      near: 1,
      far: 40,
    });
    sun.shadow.bias = -0.0006;
    sun.shadow.normalBias = 0.02;
    sun.shadow.radius = 2;
    this.scene.add(
      sun,
      sun.target,
      new HemisphereLight(0xa9c2dd, 0x3a3630, 0.9),
      new AmbientLight(0xffffff, 0.25),
    );
  }

  /** About how far the rover reaches from its middle (m). */
  private reach(): number {
    const legs = this.robot?.model.legs ?? [];
    const far = Math.max(0, ...legs.map((l) => l.reach_m));
    return Math.min(Math.max(1.6 + far, 2), 30);
  }

  private fitOnce(): void {
    if (this.fitted || !this.state || !this.raster) return;
    this.fitted = true;
    const { size, resolution_m } = this.raster.shape;
    const width = Math.max(...size) * resolution_m;
    this.scene.fog = new Fog(SKY, Math.max(25, 0.5 * width), Math.max(60, 1.6 * width));
    this.aim("iso", null, true);
  }

  private ray(x: number, y: number): Ray {
    const { clientWidth, clientHeight } = this.canvas;
    const at = new Vector2((x / clientWidth) * 2 - 1, 1 - (y / clientHeight) * 2);
    this.rig.camera.updateMatrixWorld();
    this.raycaster.setFromCamera(at, this.rig.camera);
    const { origin, direction } = this.raycaster.ray;
    return { origin: origin.toArray() as Vec3, direction: direction.toArray() as Vec3 };
  }

  private render(now: number): void {
    this.frame = 0;
    this.last = now;
    const more = this.rig.advance(now);
    this.renderer.render(this.scene, this.rig.camera);
    this.framesRendered += 1;
    this.onFrame();
    if (more) this.invalidate(true);
  }
}

function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** What the page asks for, else low where WebGL runs in software; null without WebGL 2. */
export function bestQuality(): Quality | null {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return null;
  const asked = new URLSearchParams(location.search).get("quality");
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  if (asked === "low" || asked === "high") return asked;
  return /swiftshader|llvmpipe|software/i.test(name) ? "low" : "high";
}
