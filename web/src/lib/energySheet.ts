// The energy surface as triangles: how far the center of mass would have to rise to tip, were it over
// each place of the support polygon.

import type { EnergySurface, Vec2 } from "../api/types";

export interface EnergyGrid {
  origin_m: Vec2;
  resolution_m: number;
  size: Vec2;
  /** Row by row from the first node (m); NaN outside of the support polygon. */
  height_m: Float32Array;
}

export class SurfaceError extends Error {}

/** More than the console ever asks for. */
const MAX_NODES = 40_000;

export function readEnergy(surface: EnergySurface): EnergyGrid {
  const { origin_m, resolution_m, size } = surface;
  const nodes = size[0] * size[1];
  const usable = nodes > 0 && nodes <= MAX_NODES && resolution_m > 0;
  if (!usable) throw new SurfaceError(`an energy surface of ${size[0]} × ${size[1]} nodes`);
  const bytes = Uint8Array.from(atob(surface.height_m), (c) => c.charCodeAt(0));
  if (bytes.length !== 4 * nodes) {
    throw new SurfaceError(`an energy surface of ${bytes.length} bytes for ${nodes} nodes`);
  }
  const view = new DataView(bytes.buffer);
  const height_m = Float32Array.from({ length: nodes }, (_, i) => view.getFloat32(4 * i, true));
  return { origin_m, resolution_m, size, height_m };
}

export function mostOf({ height_m }: EnergyGrid): number {
  return height_m.reduce((most, v) => (v > most ? v : most), 0);
}

interface Corner {
  at: Vec2;
  value: number;
}

export interface Sheet {
  /** Corners `[x, y]` (m), three a triangle. */
  places: Vec2[];
  /** Margin at each corner (m). */
  values: number[];
}

/** Triangles over the polygon, cut at its edges: over an edge itself nothing is left to rise. */
export function sheetOf(grid: EnergyGrid, polygon: Vec2[]): Sheet {
  const [nx, ny] = grid.size;
  const sheet: Sheet = { places: [], values: [] };
  const corner = (ix: number, iy: number): Corner => ({
    at: [grid.origin_m[0] + ix * grid.resolution_m, grid.origin_m[1] + iy * grid.resolution_m],
    value: grid.height_m[iy * nx + ix]!,
  });
  // One node beyond the grid on each side, for the polygon reaches past the last node within it.
  for (let iy = -1; iy < ny; iy++) {
    for (let ix = -1; ix < nx; ix++) {
      const square = [
        [ix, iy],
        [ix + 1, iy],
        [ix + 1, iy + 1],
        [ix, iy + 1],
      ].map(([x, y]) => {
        const outside = x! < 0 || y! < 0 || x! >= nx || y! >= ny;
        return outside ? { ...corner(x!, y!), value: NaN } : corner(x!, y!);
      });
      const told = square.filter((c) => !Number.isNaN(c.value)).length;
      const cell = told === 4 ? square : cut(square, polygon);
      for (let i = 1; i + 1 < cell.length; i++) {
        for (const c of [cell[0]!, cell[i]!, cell[i + 1]!]) {
          sheet.places.push(c.at);
          sheet.values.push(Number.isNaN(c.value) ? 0 : c.value);
        }
      }
    }
  }
  return sheet;
}

/** What of a square is within a convex counter-clockwise polygon. */
function cut(square: Corner[], polygon: Vec2[]): Corner[] {
  let left = square;
  for (let i = 0; i < polygon.length && left.length > 0; i++) {
    const [a, b] = [polygon[i]!, polygon[(i + 1) % polygon.length]!];
    const depth = ({ at }: Corner) =>
      (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0]);
    const next: Corner[] = [];
    left.forEach((from, k) => {
      const to = left[(k + 1) % left.length]!;
      const [d0, d1] = [depth(from), depth(to)];
      if (d0 >= 0) next.push(from);
      if (d0 >= 0 === d1 >= 0) return;
      const s = d0 / (d0 - d1);
      const at: Vec2 = [
        from.at[0] + s * (to.at[0] - from.at[0]),
        from.at[1] + s * (to.at[1] - from.at[1]),
      ];
      next.push({ at, value: 0 });
    });
    left = next;
  }
  return left;
}

/** Lines of equal margin as pairs of places. */
export function contoursOf({ places, values }: Sheet, step_m: number): Vec2[] {
  const ends: Vec2[] = [];
  for (let t = 0; t + 2 < places.length; t += 3) {
    const of = [values[t]!, values[t + 1]!, values[t + 2]!];
    const first = Math.floor(Math.min(...of) / step_m) + 1;
    for (let n = first; n * step_m <= Math.max(...of); n++) {
      const level = n * step_m;
      const crossing: Vec2[] = [];
      for (let k = 0; k < 3; k++) {
        const [v0, v1] = [of[k]!, of[(k + 1) % 3]!];
        if (v0 < level === v1 < level) continue;
        const s = (level - v0) / (v1 - v0);
        const [p, q] = [places[t + k]!, places[t + ((k + 1) % 3)]!];
        crossing.push([p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])]);
      }
      if (crossing.length === 2) ends.push(...crossing);
    }
  }
  return ends;
}

/** A round distance between lines, for about five of them. */
export function contourStep(most_m: number): number {
  return [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5].find((s) => most_m / s <= 6) ?? 10;
}

/** Node distance (m) for a polygon: fine enough to look smooth, few enough to be quick. */
export function surfaceResolution(polygon: Vec2[]): number {
  const span = (axis: 0 | 1) => {
    const values = polygon.map((p) => p[axis]);
    return Math.max(...values) - Math.min(...values);
  };
  return Math.max(0.02, Math.max(span(0), span(1)) / 56);
}

/** Cividis, which is read alike with and without color vision: dark blue over gray to yellow. */
const CIVIDIS: [number, number, number][] = [
  [0, 34, 78],
  [18, 53, 112],
  [59, 73, 108],
  [87, 93, 109],
  [112, 113, 115],
  [138, 134, 120],
  [165, 156, 116],
  [195, 179, 105],
  [225, 204, 85],
  [254, 232, 56],
];

/** Red, green and blue, 0 to 1, of a share of the most. */
export function cividis(share: number): [number, number, number] {
  const at = Math.min(1, Math.max(0, share)) * (CIVIDIS.length - 1);
  const i = Math.min(CIVIDIS.length - 2, Math.floor(at));
  const s = at - i;
  return [0, 1, 2].map((c) => (CIVIDIS[i]![c]! * (1 - s) + CIVIDIS[i + 1]![c]! * s) / 255) as [
    number,
    number,
    number,
  ];
}
