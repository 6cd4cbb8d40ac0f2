// Lines of a width in pixels; drawn solid in front and faint behind, so that they are never lost.

import { Group } from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";

import type { Vec3 } from "../api/types";

export interface LineStyle {
  color: string;
  width: number;
  dashed?: boolean;
  opacity?: number;
  /** Opacity where something is in front, 0 for hidden. */
  behind?: number;
}

export function line(points: Vec3[], style: LineStyle): Group {
  const group = new Group();
  if (points.length < 2) return group;
  const geometry = new LineGeometry();
  geometry.setPositions(points.flat());
  const make = (depthTest: boolean, opacity: number) => {
    const material = new LineMaterial({
      color: style.color,
      linewidth: style.width,
      transparent: true,
      opacity,
      depthTest,
      depthWrite: false,
      dashed: style.dashed ?? false,
      dashSize: 0.16,
      gapSize: 0.1,
    });
    const drawn = new Line2(geometry, material);
    if (style.dashed) drawn.computeLineDistances();
    drawn.renderOrder = depthTest ? 4 : 3;
    group.add(drawn);
  };
  make(true, style.opacity ?? 1);
  if ((style.behind ?? 0) > 0) make(false, style.behind ?? 0);
  return group;
}

/** Empties a group and frees what it drew. */
export function clearGroup(group: Group): void {
  group.traverse((node) => {
    if ("geometry" in node) (node.geometry as { dispose(): void }).dispose();
    if ("material" in node) {
      const material = node.material as { dispose(): void } | { dispose(): void }[];
      for (const m of Array.isArray(material) ? material : [material]) m.dispose();
    }
  });
  group.clear();
}
