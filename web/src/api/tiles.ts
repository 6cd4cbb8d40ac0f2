// Binary rasters: terrain tiles and reachability grids. The layout is that of crates/wire/tile.rs;
// what does not fit it exactly is refused, whatever its header promises.

export const HEADER_LEN = 64;
const MAX_NODES_A_SIDE = 8192;
const MAX_PLANES = 8;

export interface RasterHeader {
  format: "u16" | "f32" | "u8";
  planes: number;
  size: [number, number];
  origin_m: [number, number];
  resolution_m: number;
  z_min_m: number;
  z_scale_m: number;
  time_ns: bigint;
}

export class TileError extends Error {}

const FORMATS = ["u16", "f32", "u8"] as const;
const WIDTHS = { u16: 2, f32: 4, u8: 1 } as const;

export function readHeader(buffer: ArrayBuffer): RasterHeader {
  if (buffer.byteLength < HEADER_LEN) {
    throw new TileError(`a raster needs ${HEADER_LEN} bytes of header, got ${buffer.byteLength}`);
  }
  const view = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== "FFT1") throw new TileError("this is not a FootFall raster");
  const format = FORMATS[view.getUint16(4, true)];
  if (format === undefined) throw new TileError(`unknown format ${view.getUint16(4, true)}`);
  const planes = view.getUint16(6, true);
  if (planes < 1 || planes > MAX_PLANES) throw new TileError(`${planes} planes`);
  const size: [number, number] = [view.getUint32(8, true), view.getUint32(12, true)];
  if (size.some((n) => n < 1 || n > MAX_NODES_A_SIDE)) {
    throw new TileError(`a size of ${size[0]} × ${size[1]} nodes`);
  }
  const float = (offset: number) => view.getFloat64(offset, true);
  const origin_m: [number, number] = [float(16), float(24)];
  const resolution_m = float(32);
  if (!origin_m.every(Number.isFinite) || !(resolution_m > 0 && Number.isFinite(resolution_m))) {
    throw new TileError("origin or resolution is no usable number");
  }
  const header: RasterHeader = {
    format,
    planes,
    size,
    origin_m,
    resolution_m,
    z_min_m: float(40),
    z_scale_m: float(48),
    time_ns: view.getBigUint64(56, true),
  };
  if (format === "u16" && !(Number.isFinite(header.z_min_m) && Number.isFinite(header.z_scale_m))) {
    throw new TileError("height of a step is no usable number");
  }
  return header;
}

function expectLength(buffer: ArrayBuffer, length: number): void {
  if (buffer.byteLength !== length) {
    throw new TileError(`${length} bytes expected, got ${buffer.byteLength}`);
  }
}

/** f32 values of one block; the platform is little-endian like the wire, or they are swapped. */
function floats(buffer: ArrayBuffer, offset: number, count: number): Float32Array {
  if (offset % 4 === 0 && new Uint8Array(new Uint16Array([1]).buffer)[0] === 1) {
    return new Float32Array(buffer, offset, count);
  }
  const view = new DataView(buffer);
  return Float32Array.from({ length: count }, (_, i) => view.getFloat32(offset + 4 * i, true));
}

export interface ValueTile {
  header: RasterHeader;
  /** First plane; NaN is unknown. */
  values: Float32Array;
}

/** A tile of heights or of another quantity: u16 steps or f32. */
export function readValueTile(buffer: ArrayBuffer): ValueTile {
  const header = readHeader(buffer);
  if (header.format === "u8") throw new TileError("values expected, got classes");
  const count = header.size[0] * header.size[1];
  expectLength(buffer, HEADER_LEN + header.planes * count * WIDTHS[header.format]);
  if (header.format === "f32") return { header, values: floats(buffer, HEADER_LEN, count) };
  const view = new DataView(buffer, HEADER_LEN);
  const values = new Float32Array(count);
  for (let i = 0; i < count; i++) {
    const step = view.getUint16(2 * i, true);
    values[i] = step === 0 ? NaN : header.z_min_m + (step - 1) * header.z_scale_m;
  }
  return { header, values };
}

export interface ClassTile {
  header: RasterHeader;
  classes: Uint8Array;
}

/** A tile of classes (u8). */
export function readClassTile(buffer: ArrayBuffer): ClassTile {
  const header = readHeader(buffer);
  if (header.format !== "u8") throw new TileError("classes expected, got values");
  const count = header.size[0] * header.size[1];
  expectLength(buffer, HEADER_LEN + header.planes * count);
  return { header, classes: new Uint8Array(buffer, HEADER_LEN, count) };
}

export interface ReachGrid {
  header: RasterHeader;
  classes: Uint8Array;
  reasons: Uint8Array;
  /** By how much the failing check fails (m). */
  missing: Float32Array;
  /** Margin of stability (m). */
  margin: Float32Array;
}

/** A reachability grid: two u8 blocks, padding to four bytes, two f32 blocks. */
export function readReachGrid(buffer: ArrayBuffer): ReachGrid {
  const header = readHeader(buffer);
  if (header.format !== "u8" || header.planes !== 4) {
    throw new TileError("a reachability grid has format u8 and 4 planes");
  }
  const count = header.size[0] * header.size[1];
  const floatsAt = HEADER_LEN + Math.ceil((2 * count) / 4) * 4;
  expectLength(buffer, floatsAt + 8 * count);
  return {
    header,
    classes: new Uint8Array(buffer, HEADER_LEN, count),
    reasons: new Uint8Array(buffer, HEADER_LEN + count, count),
    missing: floats(buffer, floatsAt, count),
    margin: floats(buffer, floatsAt + 4 * count, count),
  };
}

/** Index of the node nearest to a place, or -1 outside. */
export function nodeAt(header: RasterHeader, x_m: number, y_m: number): number {
  const col = Math.round((x_m - header.origin_m[0]) / header.resolution_m);
  const row = Math.round((y_m - header.origin_m[1]) / header.resolution_m);
  const inside = col >= 0 && row >= 0 && col < header.size[0] && row < header.size[1];
  return inside ? row * header.size[0] + col : -1;
}
