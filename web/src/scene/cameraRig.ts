// The camera: z up, orbiting, aimed by presets, eased in at most 200 ms.

import { PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Vec3 } from "../api/types";

const EASE_MS = 180;

export class CameraRig {
  readonly camera = new PerspectiveCamera(36, 1, 0.1, 4000);
  readonly controls: OrbitControls;
  private ease: {
    from: Vector3;
    to: Vector3;
    target0: Vector3;
    target1: Vector3;
    start: number;
  } | null = null;

  constructor(canvas: HTMLCanvasElement, onChange: () => void) {
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(7, -7, 6);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.minDistance = 1.2;
    this.controls.maxDistance = 400;
    this.controls.zoomSpeed = 1.4;
    this.controls.addEventListener("change", onChange);
    this.controls.addEventListener("start", () => (this.ease = null));
  }

  /** `left` and `right` are covered by panels (px): what is looked at moves to the free middle. */
  resize(width: number, height: number, left: number, right: number): void {
    this.camera.aspect = width / height;
    this.camera.setViewOffset(width, height, (right - left) / 2, 0, width, height);
  }

  /** Looks at `target` from the direction `from` (not unit) at `distance` (m). */
  aim(target: Vec3, from: Vec3, distance: number, at_once: boolean): void {
    const target1 = new Vector3(...target);
    const to = new Vector3(...from).normalize().multiplyScalar(distance).add(target1);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (at_once || still) {
      this.camera.position.copy(to);
      this.controls.target.copy(target1);
      this.ease = null;
      this.controls.update();
      return;
    }
    this.ease = {
      from: this.camera.position.clone(),
      to,
      target0: this.controls.target.clone(),
      target1,
      start: performance.now(),
    };
  }

  /** Goes to a place without looking elsewhere. */
  moveTo(place: Vector3): void {
    const target = this.controls.target;
    const arm = new Vector3().subVectors(place, target);
    this.aim(target.toArray(), arm.toArray(), arm.length(), false);
  }

  /** Moves on with the easing; true while there is more to come. */
  advance(now: number): boolean {
    if (!this.ease) return false;
    const { from, to, target0, target1, start } = this.ease;
    const s = Math.min(1, (now - start) / EASE_MS);
    const smooth = s * s * (3 - 2 * s);
    this.camera.position.lerpVectors(from, to, smooth);
    this.controls.target.lerpVectors(target0, target1, smooth);
    if (s >= 1) this.ease = null;
    this.controls.update();
    return this.ease !== null;
  }

  /** Pixels that one meter takes at what is looked at. */
  pixelsPerMetre(height: number): number {
    const distance = this.camera.position.distanceTo(this.controls.target);
    return height / (2 * distance * Math.tan((this.camera.fov * Math.PI) / 360));
  }

  /** Angle of the view in the plane (rad): 0 looks along +y (north). */
  bearing(): number {
    const d = new Vector3().subVectors(this.controls.target, this.camera.position);
    return Math.atan2(d.x, d.y);
  }

  dispose(): void {
    this.controls.dispose();
  }
}
