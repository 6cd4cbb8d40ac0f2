// The ground: a mesh of the map, shaded by a relief texture at full resolution, with an overlay of
// classes blended in. The mesh may be coarser than the map; relief and overlay never are.

import {
  BufferAttribute,
  BufferGeometry,
  CanvasTexture,
  ClampToEdgeWrapping,
  Color,
  DataTexture,
  Group,
  LinearFilter,
  Mesh,
  MeshLambertMaterial,
  NearestFilter,
  RedFormat,
  RGBAFormat,
  SRGBColorSpace,
  type Texture,
  UnsignedByteType,
  Vector2,
  Vector3,
} from "three";

import { GROUND_COLOR, GROUND_NORMAL, GROUND_PARS, GROUND_VERTEX } from "./groundShader";
import type { HeightRaster, RasterShape } from "./heightRaster";
import { type ClassStyle, HATCH } from "./palette";

export interface OverlayRaster {
  shape: RasterShape;
  classes: Uint8Array;
  styles: ClassStyle[];
  /** Only nodes within this circle are painted: center x, y and radius (m). */
  circle?: [number, number, number];
}

/** A picture that is laid over the ground, first row the greatest y. */
export interface DrapeImage {
  canvas: HTMLCanvasElement;
  /** Outer corner of the least x and y (m). */
  origin_m: [number, number];
  extent_m: [number, number];
}

const MAX_TEXTURE = 2048;
const CLASSES = 12;

function emptyTexture(): DataTexture {
  const texture = new DataTexture(new Uint8Array(1), 1, 1, RedFormat);
  texture.needsUpdate = true;
  return texture;
}

export class Ground {
  readonly group = new Group();
  private mesh: Mesh<BufferGeometry, MeshLambertMaterial> | null = null;
  private readonly uniforms = {
    uRelief: { value: emptyTexture() },
    uOrigin: { value: new Vector2() },
    uExtent: { value: new Vector2(1, 1) },
    uReliefNodes: { value: new Vector2(1, 1) },
    uPicture: { value: emptyTexture() as Texture },
    uPictureOrigin: { value: new Vector2() },
    uPictureExtent: { value: new Vector2(1, 1) },
    uPictureOn: { value: 0 },
    uRaster: { value: emptyTexture() as Texture },
    uRasterOrigin: { value: new Vector2() },
    uRasterExtent: { value: new Vector2(1, 1) },
    uRasterOn: { value: 0 },
    uClasses: { value: emptyTexture() },
    uOverlayOrigin: { value: new Vector2() },
    uOverlayNodes: { value: new Vector2(1, 1) },
    uOverlayStep: { value: 1 },
    uOverlayOn: { value: 0 },
    uOverlayCircle: { value: new Vector3() },
    uStyles: { value: Array.from({ length: CLASSES }, () => new Color()) },
    uStrengths: { value: new Float32Array(CLASSES) },
    uHatches: { value: new Float32Array(CLASSES) },
  };

  constructor(private readonly maxCells: number) {}

  setRaster(raster: HeightRaster): void {
    this.clear();
    const { origin_m, resolution_m, size } = raster.shape;
    const u = this.uniforms;
    u.uRelief.value.dispose();
    u.uRelief.value = reliefTexture(raster);
    u.uOrigin.value.set(...origin_m);
    u.uExtent.value.set((size[0] - 1) * resolution_m, (size[1] - 1) * resolution_m);
    u.uReliefNodes.value.set(u.uRelief.value.image.width, u.uRelief.value.image.height);
    const mesh = new Mesh(groundGeometry(raster, this.maxCells), this.material());
    mesh.receiveShadow = true;
    mesh.castShadow = true;
    this.mesh = mesh;
    this.group.add(mesh);
  }

  setOverlay(overlay: OverlayRaster | null): void {
    const u = this.uniforms;
    u.uOverlayOn.value = overlay ? 1 : 0;
    if (!overlay) return;
    const [w, h] = overlay.shape.size;
    u.uClasses.value.dispose();
    const texture = new DataTexture(overlay.classes, w, h, RedFormat, UnsignedByteType);
    texture.magFilter = texture.minFilter = NearestFilter;
    texture.unpackAlignment = 1;
    texture.needsUpdate = true;
    u.uClasses.value = texture;
    u.uOverlayOrigin.value.set(...overlay.shape.origin_m);
    u.uOverlayNodes.value.set(w, h);
    u.uOverlayCircle.value.set(...(overlay.circle ?? [0, 0, 0]));
    u.uOverlayStep.value = overlay.shape.resolution_m;
    for (const style of overlay.styles) {
      if (style.value >= CLASSES) continue;
      u.uStyles.value[style.value]!.set(style.color);
      u.uStrengths.value[style.value] = style.strength;
      u.uHatches.value[style.value] = HATCH[style.hatch];
    }
  }

  /** Lays the picture of the cameras over the ground, as it is. */
  setPicture(image: DrapeImage | null): void {
    const u = this.uniforms;
    u.uPictureOn.value = image ? 1 : 0;
    u.uPicture.value = drape(
      image,
      u.uPicture.value,
      u.uPictureOrigin.value,
      u.uPictureExtent.value,
    );
  }

  /** Lays an imported raster over the ground. */
  setImported(image: DrapeImage | null, opacity: number): void {
    const u = this.uniforms;
    u.uRasterOn.value = image ? opacity : 0;
    u.uRaster.value = drape(image, u.uRaster.value, u.uRasterOrigin.value, u.uRasterExtent.value);
  }

  clear(): void {
    if (!this.mesh) return;
    this.group.remove(this.mesh);
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.mesh = null;
  }

  dispose(): void {
    this.clear();
    this.uniforms.uRelief.value.dispose();
    this.uniforms.uClasses.value.dispose();
    this.uniforms.uPicture.value.dispose();
    this.uniforms.uRaster.value.dispose();
  }

  private material(): MeshLambertMaterial {
    const material = new MeshLambertMaterial({ color: 0xffffff });
    material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.uniforms);
      shader.vertexShader = shader.vertexShader.replace(
        "void main() {",
        "varying vec2 vGround;\nvoid main() {\n" + GROUND_VERTEX,
      );
      shader.fragmentShader = shader.fragmentShader
        .replace("void main() {", GROUND_PARS + "\nvoid main() {")
        .replace("#include <color_fragment>", "#include <color_fragment>\n" + GROUND_COLOR)
        .replace(
          "#include <normal_fragment_begin>",
          "#include <normal_fragment_begin>\n" + GROUND_NORMAL,
        );
    };
    material.customProgramCacheKey = () => "ground";
    return material;
  }
}

/** The texture of an image in place of the one before. */
function drape(
  image: DrapeImage | null,
  before: Texture,
  origin: Vector2,
  extent: Vector2,
): Texture {
  if (image !== null && before.image === image.canvas) return before;
  before.dispose();
  if (image === null) return emptyTexture();
  origin.set(...image.origin_m);
  extent.set(...image.extent_m);
  const texture = new CanvasTexture(image.canvas);
  texture.colorSpace = SRGBColorSpace;
  texture.anisotropy = 4;
  return texture;
}

/** Nodes of the mesh along a side: all of them, or evenly left out. */
export function meshNodes(nodes: number, maxCells: number): number {
  return Math.min(nodes, maxCells + 1);
}

function groundGeometry(raster: HeightRaster, maxCells: number): BufferGeometry {
  const { origin_m, resolution_m, size } = raster.shape;
  const nx = meshNodes(size[0], maxCells);
  const ny = meshNodes(size[1], maxCells);
  const positions = new Float32Array(3 * nx * ny);
  const normals = new Float32Array(3 * nx * ny);
  for (let j = 0, p = 0; j < ny; j++) {
    const row = Math.round((j * (size[1] - 1)) / (ny - 1));
    for (let i = 0; i < nx; i++, p += 3) {
      const col = Math.round((i * (size[0] - 1)) / (nx - 1));
      positions[p] = origin_m[0] + col * resolution_m;
      positions[p + 1] = origin_m[1] + row * resolution_m;
      positions[p + 2] = raster.heights[row * size[0] + col]!;
      normals[p + 2] = 1;
    }
  }
  const index = new Uint32Array(6 * (nx - 1) * (ny - 1));
  for (let j = 0, k = 0; j < ny - 1; j++) {
    for (let i = 0; i < nx - 1; i++, k += 6) {
      const a = j * nx + i;
      index.set([a, a + 1, a + nx, a + 1, a + nx + 1, a + nx], k);
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new BufferAttribute(normals, 3));
  geometry.setIndex(new BufferAttribute(index, 1));
  return geometry;
}

/** Normal (x, y), relief shade and knownness of each node as one RGBA texture. */
function reliefTexture(raster: HeightRaster): DataTexture {
  const { resolution_m, size } = raster.shape;
  const skip = Math.ceil(Math.max(size[0], size[1]) / MAX_TEXTURE);
  const nx = Math.ceil(size[0] / skip);
  const ny = Math.ceil(size[1] / skip);
  const data = new Uint8Array(4 * nx * ny);
  const z = raster.heights;
  const at = (i: number, j: number) =>
    z[Math.min(Math.max(j, 0), size[1] - 1) * size[0] + Math.min(Math.max(i, 0), size[0] - 1)]!;
  const wide = Math.max(2, Math.round(0.25 / resolution_m));
  for (let j = 0, p = 0; j < ny; j++) {
    for (let i = 0; i < nx; i++, p += 4) {
      const [u, v] = [i * skip, j * skip];
      const dx = (at(u + 1, v) - at(u - 1, v)) / (2 * resolution_m);
      const dy = (at(u, v + 1) - at(u, v - 1)) / (2 * resolution_m);
      const length = Math.hypot(dx, dy, 1);
      const around = at(u + wide, v) + at(u - wide, v) + at(u, v + wide) + at(u, v - wide);
      const bulge = (at(u, v) - around / 4) / (wide * resolution_m);
      data[p] = Math.round(127.5 * (1 - dx / length));
      data[p + 1] = Math.round(127.5 * (1 - dy / length));
      data[p + 2] = Math.round(127.5 * (1 + Math.max(-1, Math.min(1, 2.5 * bulge))));
      data[p + 3] = 255 * raster.known[v * size[0] + u]!;
    }
  }
  const texture = new DataTexture(data, nx, ny, RGBAFormat, UnsignedByteType);
  texture.magFilter = texture.minFilter = LinearFilter;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}
