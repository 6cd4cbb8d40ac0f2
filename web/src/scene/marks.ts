// Marks of the operator's doing: the picked place, the planned way of the wheel, its footfall.

import { Group, Mesh, MeshBasicMaterial, RingGeometry, Vector3 } from "three";

import type { Vec3 } from "../api/types";
import type { HeightRaster } from "./heightRaster";
import { clearGroup, keptMaterial, line } from "./lines";

const ACCENT = "#7cbcff";
/** Where there is no plan: told apart by its cross as well, and no status. */
const NO_PLAN = "#f0b9a0";
const TURN = 48;

/** Where a wheel comes to stand. */
export interface FootfallMark {
  at: Vec3;
  normal: Vec3;
  radius_m: number;
}

/** What is drawn of a plan that follows the pointer. */
export interface FollowMark {
  way: Vec3[];
  footfall: FootfallMark | null;
  /** The place asked for, where there is no plan to it; crossed out where there is to be none. */
  refused: Vec3 | null;
  crossed: boolean;
  /** The nearest place to it that there would be a plan to. */
  nearest: Vec3 | null;
  radius_m: number;
  dim: boolean;
}

export class Marks {
  readonly group = new Group();
  private readonly pick = new Group();
  private readonly trace = new Group();
  private readonly nearest = new Group();
  private readonly follow = new Group();

  constructor() {
    this.group.add(this.pick, this.trace, this.nearest, this.follow);
  }

  /** A ring of the wheel's radius laid on the ground around the picked point. */
  setPick(at: Vec3 | null, raster: HeightRaster | null, radius_m: number): void {
    clearGroup(this.pick);
    if (!at) return;
    this.pick.add(
      line(ringOn(raster, at, radius_m), { color: "#ffffff", width: 2.4, behind: 0.5 }),
    );
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

  setTrace(way: Vec3[], footfall: FootfallMark | null): void {
    clearGroup(this.trace);
    if (way.length > 1) {
      this.trace.add(line(way, { color: ACCENT, width: 2.2, dashed: true, behind: 0.45 }));
    }
    if (footfall) this.trace.add(footfallRing(footfall, 0.8));
  }

  /** A small ring where there would be a plan instead of to the picked place. */
  setNearest(at: Vec3 | null, raster: HeightRaster | null, radius_m: number): void {
    clearGroup(this.nearest);
    if (at) this.nearest.add(nearestRing(raster, at, radius_m, 1));
  }

  /** Thinner and paler than a plan that may be sent. */
  setFollow(mark: FollowMark | null, raster: HeightRaster | null): void {
    clearGroup(this.follow);
    if (!mark) return;
    const { way, footfall, refused, nearest, radius_m } = mark;
    const opacity = mark.dim ? 0.4 : 0.9;
    const behind = mark.dim ? 0.15 : 0.35;
    if (way.length > 1) this.follow.add(line(way, { color: ACCENT, width: 1.8, opacity, behind }));
    if (footfall) this.follow.add(footfallRing(footfall, 0.65 * opacity));
    if (refused) {
      const style = { color: NO_PLAN, width: 1.8, opacity, behind };
      this.follow.add(line(ringOn(raster, refused, 0.7 * radius_m), style));
      const reach = 0.3 * radius_m;
      for (const side of mark.crossed ? [1, -1] : []) {
        const end = (s: number): Vec3 => onGround(raster, refused, s * reach, s * side * reach);
        this.follow.add(line([end(-1), end(1)], style));
      }
    }
    if (refused && nearest) {
      this.follow.add(nearestRing(raster, nearest, radius_m, opacity));
      const far = Math.hypot(nearest[0] - refused[0], nearest[1] - refused[1]);
      const steps = Math.min(40, Math.max(1, Math.ceil(far / 0.1)));
      const to = Array.from({ length: steps + 1 }, (_, i) =>
        onGround(
          raster,
          refused,
          (i / steps) * (nearest[0] - refused[0]),
          (i / steps) * (nearest[1] - refused[1]),
        ),
      );
      this.follow.add(
        line(to, { color: ACCENT, width: 1.2, dashed: true, opacity: 0.6 * opacity }),
      );
    }
  }

  dispose(): void {
    for (const group of [this.pick, this.trace, this.nearest, this.follow]) clearGroup(group);
  }
}

const ABOVE_M = 0.04;

/** A place beside another, on the ground. */
function onGround(raster: HeightRaster | null, at: Vec3, dx: number, dy: number): Vec3 {
  const [x, y] = [at[0] + dx, at[1] + dy];
  const z = raster?.heightAt(x, y) ?? NaN;
  return [x, y, (Number.isNaN(z) ? at[2] : z) + ABOVE_M];
}

function ringOn(raster: HeightRaster | null, at: Vec3, radius_m: number): Vec3[] {
  return Array.from({ length: TURN + 1 }, (_, i) => {
    const angle = (i / TURN) * 2 * Math.PI;
    return onGround(raster, at, radius_m * Math.cos(angle), radius_m * Math.sin(angle));
  });
}

function nearestRing(raster: HeightRaster | null, at: Vec3, radius_m: number, opacity: number) {
  const ring = ringOn(raster, at, 0.45 * radius_m);
  return line(ring, { color: ACCENT, width: 2.2, opacity, behind: 0.4 * opacity });
}

function footfallRing({ at, normal, radius_m }: FootfallMark, opacity: number): Mesh {
  const ring = new Mesh(
    new RingGeometry(radius_m * 0.82, radius_m, TURN),
    keptMaterial(
      `footfall ${opacity}`,
      () =>
        new MeshBasicMaterial({
          color: ACCENT,
          transparent: true,
          opacity,
          depthTest: false,
          side: 2,
        }),
    ),
  );
  const up = new Vector3(...normal).normalize();
  ring.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), up);
  ring.position.set(...at).addScaledVector(up, 0.05);
  ring.renderOrder = 4;
  return ring;
}
