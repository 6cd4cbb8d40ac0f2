import { describe, expect, it } from "vitest";

import {
  HEADER_LEN,
  nodeAt,
  readClassTile,
  readReachGrid,
  readValueTile,
  TileError,
} from "./tiles";

interface Fields {
  magic?: string;
  format?: number;
  planes?: number;
  size?: [number, number];
  origin?: [number, number];
  resolution?: number;
  zMin?: number;
  zScale?: number;
}

/** A raster written by the table in crates/wire/tile.rs. */
function raster(fields: Fields, body: number): DataView {
  const view = new DataView(new ArrayBuffer(HEADER_LEN + body));
  [...(fields.magic ?? "FFT1")].forEach((c, i) => view.setUint8(i, c.charCodeAt(0)));
  view.setUint16(4, fields.format ?? 1, true);
  view.setUint16(6, fields.planes ?? 1, true);
  view.setUint32(8, fields.size?.[0] ?? 2, true);
  view.setUint32(12, fields.size?.[1] ?? 2, true);
  view.setFloat64(16, fields.origin?.[0] ?? 0, true);
  view.setFloat64(24, fields.origin?.[1] ?? 0, true);
  view.setFloat64(32, fields.resolution ?? 0.5, true);
  view.setFloat64(40, fields.zMin ?? 0, true);
  view.setFloat64(48, fields.zScale ?? 0, true);
  return view;
}

const buffer = (view: DataView) => view.buffer as ArrayBuffer;

describe("value tiles", () => {
  it("a u16 step of zero is unknown, one is the lowest height", () => {
    const view = raster({ format: 0, zMin: -3, zScale: 0.25 }, 8);
    [0, 1, 2, 41].forEach((step, i) => view.setUint16(HEADER_LEN + 2 * i, step, true));
    const { values } = readValueTile(buffer(view));
    expect([...values]).toEqual([NaN, -3, -2.75, 7]);
  });

  it("f32 values come as they are, with their place", () => {
    const view = raster({ format: 1, origin: [-10, 4], resolution: 0.05 }, 16);
    [1.5, NaN, -2, 0].forEach((z, i) => view.setFloat32(HEADER_LEN + 4 * i, z, true));
    const { header, values } = readValueTile(buffer(view));
    expect([...values]).toEqual([1.5, NaN, -2, 0]);
    expect(header.origin_m).toEqual([-10, 4]);
    expect(header.resolution_m).toBe(0.05);
  });
});

describe("class tiles and reachability grids", () => {
  it("classes are bytes", () => {
    const view = raster({ format: 2 }, 4);
    [0, 1, 2, 3].forEach((c, i) => view.setUint8(HEADER_LEN + i, c));
    expect([...readClassTile(buffer(view)).classes]).toEqual([0, 1, 2, 3]);
  });

  it("the f32 blocks of a grid follow the padding", () => {
    // 3 × 3 nodes: 18 bytes of classes and reasons, padded to 20.
    const view = raster({ format: 2, planes: 4, size: [3, 3] }, 20 + 72);
    view.setUint8(HEADER_LEN + 8, 4);
    view.setUint8(HEADER_LEN + 9, 7);
    view.setFloat32(HEADER_LEN + 20, 0.25, true);
    view.setFloat32(HEADER_LEN + 20 + 36 + 32, 0.75, true);
    const grid = readReachGrid(buffer(view));
    expect([grid.classes[8], grid.reasons[0], grid.missing[0], grid.margin[8]]).toEqual([
      4, 7, 0.25, 0.75,
    ]);
  });

  it("a place belongs to its nearest node, or to none", () => {
    const view = raster({ format: 2, size: [3, 3], origin: [1, 2], resolution: 0.5 }, 9);
    const { header } = readClassTile(buffer(view));
    expect(nodeAt(header, 1.24, 2)).toBe(0);
    expect(nodeAt(header, 1.26, 2)).toBe(1);
    expect(nodeAt(header, 2, 3)).toBe(8);
    expect(nodeAt(header, 2.3, 3)).toBe(-1);
    expect(nodeAt(header, 0.7, 3)).toBe(-1);
  });
});

describe("what does not fit is refused", () => {
  const cases: [string, DataView][] = [
    ["no header", new DataView(new ArrayBuffer(10))],
    ["another magic", raster({ magic: "JUNK" }, 16)],
    ["unknown format", raster({ format: 9 }, 16)],
    ["no planes", raster({ planes: 0 }, 16)],
    ["many planes", raster({ planes: 65535 }, 16)],
    ["empty size", raster({ size: [0, 2] }, 0)],
    ["huge size", raster({ size: [0xffffffff, 0xffffffff] }, 16)],
    ["huge but allowed side without its bytes", raster({ size: [8192, 8192] }, 16)],
    ["one byte short", raster({}, 15)],
    ["one byte more", raster({}, 17)],
    ["resolution zero", raster({ resolution: 0 }, 16)],
    ["resolution NaN", raster({ resolution: NaN }, 16)],
    ["origin infinite", raster({ origin: [Infinity, 0] }, 16)],
    ["scale NaN", raster({ format: 0, zScale: NaN }, 8)],
  ];
  it.each(cases)("%s", (_, view) => {
    expect(() => readValueTile(buffer(view))).toThrow(TileError);
  });

  it("values are no classes and classes no grid", () => {
    expect(() => readClassTile(buffer(raster({ format: 1 }, 16)))).toThrow(TileError);
    expect(() => readValueTile(buffer(raster({ format: 2 }, 4)))).toThrow(TileError);
    expect(() => readReachGrid(buffer(raster({ format: 2, planes: 1 }, 4)))).toThrow(TileError);
    expect(() => readReachGrid(buffer(raster({ format: 2, planes: 4 }, 39)))).toThrow(TileError);
  });
});
