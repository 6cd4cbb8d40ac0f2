// The ground as a grid of nodes: heights for looking at, and whether each is known.

import type { ValueTile } from "../api/tiles";
import type { Vec3 } from "../api/types";

export interface RasterShape {
  origin_m: [number, number];
  resolution_m: number;
  /** Nodes along x and y. */
  size: [number, number];
}

const MAX_NODES = 64e6;

export class HeightRaster {
  /** Heights by node, rows along x; unknown nodes carry a filled-in height. */
  readonly heights: Float32Array;
  /** 1 where the height is measured, 0 where it is filled in. */
  readonly known: Uint8Array;
  z_min_m = 0;
  z_max_m = 0;

  constructor(readonly shape: RasterShape) {
    const [w, h] = shape.size;
    if (!(w >= 2 && h >= 2 && w * h <= MAX_NODES)) {
      throw new RangeError(`a map of ${w} × ${h} nodes cannot be shown`);
    }
    this.heights = new Float32Array(w * h).fill(NaN);
    this.known = new Uint8Array(w * h);
  }

  /** Copies a tile to where its origin says; nodes outside the map are left out. */
  place(tile: ValueTile): void {
    const { origin_m, resolution_m, size } = this.shape;
    const col0 = Math.round((tile.header.origin_m[0] - origin_m[0]) / resolution_m);
    const row0 = Math.round((tile.header.origin_m[1] - origin_m[1]) / resolution_m);
    const [tw, th] = tile.header.size;
    const from = Math.max(0, -col0);
    const to = Math.min(tw, size[0] - col0);
    if (to <= from) return;
    for (let row = Math.max(0, -row0); row < th && row + row0 < size[1]; row++) {
      const source = tile.values.subarray(row * tw + from, row * tw + to);
      this.heights.set(source, (row + row0) * size[0] + col0 + from);
    }
  }

  /** After all tiles: marks what is known and fills the rest so that the mesh has no holes. */
  finish(): this {
    let [low, high] = [Infinity, -Infinity];
    for (let i = 0; i < this.heights.length; i++) {
      const z = this.heights[i]!;
      if (Number.isNaN(z)) continue;
      this.known[i] = 1;
      if (z < low) low = z;
      if (z > high) high = z;
    }
    this.z_min_m = Number.isFinite(low) ? low : 0;
    this.z_max_m = Number.isFinite(high) ? high : 0;
    fillUnknown(this.heights, this.shape.size, this.z_min_m);
    return this;
  }

  contains(x: number, y: number): boolean {
    const { origin_m, resolution_m, size } = this.shape;
    const [u, v] = [(x - origin_m[0]) / resolution_m, (y - origin_m[1]) / resolution_m];
    return u >= 0 && v >= 0 && u <= size[0] - 1 && v <= size[1] - 1;
  }

  /** Height at a place (m), bilinear; NaN outside the map. */
  heightAt(x: number, y: number): number {
    if (!this.contains(x, y)) return NaN;
    const { origin_m, resolution_m, size } = this.shape;
    const u = (x - origin_m[0]) / resolution_m;
    const v = (y - origin_m[1]) / resolution_m;
    const i = Math.min(Math.floor(u), size[0] - 2);
    const j = Math.min(Math.floor(v), size[1] - 2);
    const [a, b] = [u - i, v - j];
    const at = j * size[0] + i;
    const z = this.heights;
    return (
      (1 - b) * ((1 - a) * z[at]! + a * z[at + 1]!) +
      b * ((1 - a) * z[at + size[0]]! + a * z[at + size[0] + 1]!)
    );
  }

  knownAt(x: number, y: number): boolean {
    if (!this.contains(x, y)) return false;
    const { origin_m, resolution_m, size } = this.shape;
    const col = Math.round((x - origin_m[0]) / resolution_m);
    const row = Math.round((y - origin_m[1]) / resolution_m);
    return this.known[row * size[0] + col] === 1;
  }

  point(x: number, y: number): Vec3 {
    return [x, y, this.heightAt(x, y)];
  }
}

/** Spreads known heights into the unknown along rows, then along columns. */
function fillUnknown(z: Float32Array, [w, h]: [number, number], otherwise: number): void {
  const line = (start: number, step: number, count: number) => {
    for (let pass = 0; pass < 2; pass++) {
      let last = NaN;
      for (let k = 0; k < count; k++) {
        const i = start + (pass === 0 ? k : count - 1 - k) * step;
        if (Number.isNaN(z[i]!)) z[i] = last;
        else last = z[i]!;
      }
    }
  };
  for (let row = 0; row < h; row++) line(row * w, 1, w);
  for (let col = 0; col < w; col++) line(col, w, h);
  for (let i = 0; i < z.length; i++) if (Number.isNaN(z[i]!)) z[i] = otherwise;
}
