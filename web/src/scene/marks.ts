// Marks of the operator's doing: the picked place, the planned way of the wheel, its footfall.

import { Group, Mesh, MeshBasicMaterial, RingGeometry, Vector3 } from "three";

import type { Vec3 } from "../api/types";
import type { HeightRaster } from "./heightRaster";
import { clearGroup, line } from "./lines";

const ACCENT = "#7cbcff";
const TURN = 48;

export class Marks {
  readonly group = new Group();
  private readonly pick = new Group();
  private readonly trace = new Group();

  constructor() {
    this.group.add(this.pick, this.trace);
  }

  /** A ring of the wheel's radius laid on the ground around the picked point. */
  setPick(at: Vec3 | null, raster: HeightRaster | null, radius_m: number): void {
    clearGroup(this.pick);
    if (!at) return;
    const ring: Vec3[] = Array.from({ length: TURN + 1 }, (_, i) => {
      const angle = (i / TURN) * 2 * Math.PI;
      const x = at[0] + radius_m * Math.cos(angle);
      const y = at[1] + radius_m * Math.sin(angle);
      const z = raster?.heightAt(x, y) ?? NaN;
      return [x, y, (Number.isNaN(z) ? at[2] : z) + 0.04];
    });
    this.pick.add(line(ring, { color: "#ffffff", width: 2.4, behind: 0.5 }));
    const tick = (dx: number, dy: number) =>
      line([at, [at[0] + dx, at[1] + dy, at[2] + 0.04]], {
        color: "#ffffff",
        width: 1.2,
        behind: 0.4,
      });
    this.pick.add(tick(0.12, 0), tick(-0.12, 0), tick(0, 0.12), tick(0, -0.12));
    this.pick.add(
      line([at, [at[0], at[1], at[2] + 0.9]], {
        color: "#ffffff",
        width: 1,
        opacity: 0.5,
        behind: 0.2,
      }),
    );
  }

  setTrace(way: Vec3[], footfall: { at: Vec3; normal: Vec3; radius_m: number } | null): void {
    clearGroup(this.trace);
    if (way.length > 1) {
      this.trace.add(line(way, { color: ACCENT, width: 2.2, dashed: true, behind: 0.45 }));
    }
    if (!footfall) return;
    const ring = new Mesh(
      new RingGeometry(footfall.radius_m * 0.82, footfall.radius_m, TURN),
      new MeshBasicMaterial({
        color: ACCENT,
        transparent: true,
        opacity: 0.8,
        depthTest: false,
        side: 2,
      }),
    );
    const normal = new Vector3(...footfall.normal).normalize();
    ring.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), normal);
    ring.position.set(...footfall.at).addScaledVector(normal, 0.05);
    ring.renderOrder = 4;
    this.trace.add(ring);
  }

  dispose(): void {
    clearGroup(this.pick);
    clearGroup(this.trace);
  }
}
