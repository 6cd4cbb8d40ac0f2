// Lets browser tests find places on the canvas; reads only.

import type { Vec3 } from "../../api/types";
import type { DrawnRegion } from "../../scene/stance";
import type { Viewer } from "../../scene/viewer";

export interface FootfallHook {
  /** Canvas pixel of a point in `world` (m), or null behind the camera. */
  project(x: number, y: number, z: number): { x: number; y: number } | null;
  /** Center of a leg's wheel in `world` (m). */
  wheel(leg: string): Vec3 | null;
  /** Center of the wheel of the planned pose in `world` (m), null while none is drawn. */
  ghost(): Vec3 | null;
  /** Height of the ground (m), NaN outside the map. */
  height(x: number, y: number): number;
  /** Kinds of support regions that are drawn. */
  regions(): DrawnRegion[];
  /** Triangles of the energy surface that is drawn. */
  energyTriangles(): number;
  readonly framesRendered: number;
  readonly quality: string;
}

declare global {
  interface Window {
    __footfall?: FootfallHook;
  }
}

export function installHook(viewer: Viewer): () => void {
  window.__footfall = {
    project: (x, y, z) => viewer.project(x, y, z),
    wheel: (leg) => viewer.robot?.wheel(leg) ?? null,
    ghost: () => viewer.robot?.ghostWheel() ?? null,
    height: (x, y) => viewer.raster?.heightAt(x, y) ?? NaN,
    regions: () => viewer.stance.drawn,
    energyTriangles: () => viewer.energy.triangles,
    get framesRendered() {
      return viewer.framesRendered;
    },
    quality: viewer.quality,
  };
  return () => {
    delete window.__footfall;
  };
}
