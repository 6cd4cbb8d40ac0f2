// The stance on the ground: support polygons, centre of mass, wheel forces.

import {
  BufferAttribute,
  BufferGeometry,
  ConeGeometry,
  CylinderGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  SphereGeometry,
  Vector3,
} from "three";

import type { PolygonAnswer, RoverTelemetry, StabilityDerived, Vec2, Vec3 } from "../api/types";
import { beside, type RegionKey, regionOf } from "../lib/regions";
import type { HeightRaster } from "./heightRaster";
import { clearGroup, line } from "./lines";
import { REGIONS, type RegionStyle } from "./palette";

export const ABOVE_M = 0.04;
const REGULAR = REGIONS[0]!.color;
const COM = "#f2f6fa";
const FORCE = "#e2c9a0";

/** A region as it was drawn, for tests. */
export interface DrawnRegion {
  key: RegionKey;
  kind: "area" | "point";
  corners: number;
}

export class StanceView {
  readonly group = new Group();
  drawn: DrawnRegion[] = [];
  private readonly polygons = new Group();
  private readonly forces = new Group();

  constructor() {
    this.group.add(this.polygons, this.forces);
  }

  /** `edgeColor` is the color of the regular polygon's critical edge: that of the margin's status. */
  setPolygons(
    stability: StabilityDerived | null,
    keys: RegionKey[],
    raster: HeightRaster | null,
    edgeColor: string,
  ): void {
    clearGroup(this.polygons);
    this.drawn = [];
    if (!stability) return;
    const others: Vec2[][] = [];
    for (const style of REGIONS.filter(({ key }) => keys.includes(key))) {
      const { polygon } = regionOf(stability, style.key);
      const outline = polygon?.polygon_m ?? [];
      if (!polygon || outline.length === 0) continue;
      const place = (p: Vec2) => beside(p, outline, others);
      this.addRegion(polygon, style, place, raster, edgeColor);
      if (outline.length >= 3) others.push(outline);
    }
    const { com_m } = stability;
    const foot: Vec3 = [com_m[0], com_m[1], groundAt(raster, com_m[0], com_m[1]) + ABOVE_M];
    this.polygons.add(line([com_m, foot], { color: COM, width: 1, opacity: 0.6, behind: 0.3 }));
    this.polygons.add(ball(com_m, 0.07, false), ball(foot, 0.06, true));
  }

  private addRegion(
    { polygon_m, critical_edge_m }: PolygonAnswer,
    style: RegionStyle,
    place: (p: Vec2) => Vec2,
    raster: HeightRaster | null,
    edgeColor: string,
  ): void {
    const { key, color, width, dashes } = style;
    const look = { color, width, dashes, behind: 0.4 };
    const area = polygon_m.length >= 3;
    this.drawn.push({ key, kind: area ? "area" : "point", corners: polygon_m.length });
    if (!area) {
      const [x, y] = polygon_m[0]!;
      this.polygons.add(line(diamond(x, y, raster), { ...look, dashes: [] }));
      return;
    }
    const corners = polygon_m.map(place);
    const outline = corners.flatMap((p, i) =>
      draped(p, corners[(i + 1) % corners.length]!, raster),
    );
    this.polygons.add(line(outline, look));
    if (key === "regular") this.polygons.add(fill(polygon_m, raster));
    if (!critical_edge_m) return;
    const [from, to] = critical_edge_m;
    const edge = draped(place(from), place(to), raster);
    // One edge carries the status; those of the other regions stand out in their own color.
    if (key === "regular") {
      this.polygons.add(line(edge, { color: edgeColor, width: 4, behind: 0.5 }));
    } else this.polygons.add(line(edge, { ...look, width: width + 1.8 }));
  }

  setForces(telemetry: RoverTelemetry | null, unit_n: number): void {
    clearGroup(this.forces);
    if (!telemetry) return;
    for (const [leg, force] of Object.entries(telemetry.wheel_forces_n)) {
      const at = telemetry.contact_points_m[leg];
      const size = Math.hypot(...force);
      if (at && size > 1) this.forces.add(arrow(at, force, Math.min(2.5, (0.8 * size) / unit_n)));
    }
  }

  dispose(): void {
    clearGroup(this.polygons);
    clearGroup(this.forces);
  }
}

/** Marks a region that is a single place. */
function diamond(x: number, y: number, raster: HeightRaster | null): Vec3[] {
  const r = 0.14;
  const corners: Vec2[] = [
    [x + r, y],
    [x, y + r],
    [x - r, y],
    [x, y - r],
    [x + r, y],
  ];
  return corners.map(([cx, cy]) => [cx, cy, groundAt(raster, cx, cy) + ABOVE_M]);
}

export function groundAt(raster: HeightRaster | null, x: number, y: number): number {
  const z = raster?.heightAt(x, y);
  return z === undefined || Number.isNaN(z) ? 0 : z;
}

function draped([x0, y0]: Vec2, [x1, y1]: Vec2, raster: HeightRaster | null): Vec3[] {
  const count = Math.max(2, Math.ceil(Math.hypot(x1 - x0, y1 - y0) / 0.15) + 1);
  return Array.from({ length: count }, (_, i) => {
    const s = i / (count - 1);
    const [x, y] = [x0 + s * (x1 - x0), y0 + s * (y1 - y0)];
    return [x, y, groundAt(raster, x, y) + ABOVE_M];
  });
}

/** A faint sheet over a convex polygon, fanned from its middle. */
function fill(polygon: Vec2[], raster: HeightRaster | null): Mesh {
  const middle = polygon.reduce<Vec2>(
    (m, p) => [m[0] + p[0] / polygon.length, m[1] + p[1] / polygon.length],
    [0, 0],
  );
  const positions = [middle, ...polygon].flatMap(([x, y]) => [
    x,
    y,
    groundAt(raster, x, y) + ABOVE_M,
  ]);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.setIndex(polygon.flatMap((_, i) => [0, i + 1, ((i + 1) % polygon.length) + 1]));
  const mesh = new Mesh(
    geometry,
    new MeshBasicMaterial({
      color: REGULAR,
      transparent: true,
      opacity: 0.06,
      depthTest: false,
      depthWrite: false,
      side: DoubleSide,
    }),
  );
  mesh.renderOrder = 2;
  return mesh;
}

function ball(at: Vec3, radius: number, through: boolean): Mesh {
  const mesh = new Mesh(
    new SphereGeometry(radius, 16, 12),
    new MeshBasicMaterial({ color: COM, depthTest: !through, transparent: true, opacity: 0.95 }),
  );
  mesh.position.set(...at);
  mesh.renderOrder = 5;
  return mesh;
}

const UP = new Vector3(0, 1, 0);

function arrow(at: Vec3, along: Vec3, length: number): Group {
  const material = new MeshBasicMaterial({
    color: FORCE,
    depthTest: false,
    transparent: true,
    opacity: 0.85,
  });
  const head = Math.min(0.2, 0.4 * length);
  const shaft = new Mesh(new CylinderGeometry(0.022, 0.022, length - head, 8), material);
  shaft.position.y = (length - head) / 2;
  const tip = new Mesh(new ConeGeometry(0.065, head, 12), material);
  tip.position.y = length - head / 2;
  const group = new Group();
  group.add(shaft, tip);
  group.position.set(...at);
  group.quaternion.setFromUnitVectors(UP, new Vector3(...along).normalize());
  for (const part of [shaft, tip]) part.renderOrder = 6;
  return group;
}
