// The energy surface over the ground: a tinted sheet within the support polygon, with lines of equal margin.

import {
  BufferGeometry,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
} from "three";

import type { Vec2 } from "../api/types";
import { cividis, contoursOf, contourStep, sheetOf } from "../lib/energySheet";
import type { Surface } from "../store/energy";
import type { HeightRaster } from "./heightRaster";
import { clearGroup, keptMaterial } from "./lines";
import { ABOVE_M, groundAt } from "./stance";

export class EnergyView {
  readonly group = new Group();
  triangles = 0;

  set(surface: Surface | null, raster: HeightRaster | null): void {
    clearGroup(this.group);
    this.triangles = 0;
    if (!surface || surface.most_m <= 0) return;
    const sheet = sheetOf(surface.grid, surface.polygon);
    this.triangles = sheet.places.length / 3;
    const geometry = laid(sheet.places, raster, 0.75 * ABOVE_M);
    const colors = sheet.values.flatMap((v) => cividis(v / surface.most_m).map(linear));
    geometry.setAttribute("color", new Float32BufferAttribute(colors, 3));
    // The ground as drawn can be coarser than the map: the sheet is pulled towards the eye.
    const mesh = new Mesh(
      geometry,
      keptMaterial(
        "energy",
        () =>
          new MeshBasicMaterial({
            vertexColors: true,
            transparent: true,
            opacity: 0.6,
            depthWrite: false,
            polygonOffset: true,
            polygonOffsetFactor: -4,
            polygonOffsetUnits: -4,
            side: DoubleSide,
          }),
      ),
    );
    mesh.renderOrder = 1;
    const ends = contoursOf(sheet, contourStep(surface.most_m));
    const contours = new LineSegments(
      laid(ends, raster, ABOVE_M),
      keptMaterial(
        "energy contours",
        () =>
          new LineBasicMaterial({
            color: "#f4f7fa",
            transparent: true,
            opacity: 0.4,
            depthWrite: false,
          }),
      ),
    );
    contours.renderOrder = 2;
    this.group.add(mesh, contours);
  }

  dispose(): void {
    clearGroup(this.group);
  }
}

/** Vertex colors are taken as linear light. */
function linear(c: number): number {
  return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
}

function laid(places: Vec2[], raster: HeightRaster | null, above_m: number): BufferGeometry {
  const positions = new Float32Array(3 * places.length);
  places.forEach(([x, y], i) => positions.set([x, y, groundAt(raster, x, y) + above_m], 3 * i));
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(positions, 3));
  return geometry;
}
