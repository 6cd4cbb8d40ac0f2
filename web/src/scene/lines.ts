// Lines of a width in pixels; drawn solid in front and faint behind, so that they are never lost.

import { Group, type Material } from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";

import type { Vec3 } from "../api/types";
import type { Dash } from "./palette";

export interface LineStyle {
  color: string;
  width: number;
  dashed?: boolean;
  /** A pattern of its own: one line for each, laid over each other. */
  dashes?: Dash[];
  opacity?: number;
  /** Opacity where something is in front, 0 for hidden. */
  behind?: number;
}

/**
 * Materials by what they look like, kept for good: a program whose last material is freed is compiled
 * again for the next one, which takes longer than all else that is done for a line.
 */
const kept = new Map<string, Material>();

export function keptMaterial<M extends Material>(key: string, make: () => M): M {
  const known = kept.get(key);
  if (known) return known as M;
  const made = make();
  made.userData.kept = true;
  kept.set(key, made);
  return made;
}

const DASHED: Dash = [0.16, 0.1, 0];

function lineMaterial(
  { color, width }: LineStyle,
  dash: Dash | null,
  depthTest: boolean,
  opacity: number,
): LineMaterial {
  const [dashSize, gapSize, dashOffset] = dash ?? DASHED;
  return keptMaterial(
    `line ${color} ${width} ${dash?.join()} ${depthTest} ${opacity}`,
    () =>
      new LineMaterial({
        color,
        linewidth: width,
        transparent: true,
        opacity,
        depthTest,
        depthWrite: false,
        dashed: dash !== null,
        dashSize,
        gapSize,
        dashOffset,
      }),
  );
}

export function line(points: Vec3[], style: LineStyle): Group {
  const group = new Group();
  if (points.length < 2) return group;
  const geometry = new LineGeometry();
  geometry.setPositions(points.flat());
  const dashes = style.dashes?.length ? style.dashes : [style.dashed ? DASHED : null];
  const make = (depthTest: boolean, opacity: number) => {
    for (const dash of dashes) {
      const drawn = new Line2(geometry, lineMaterial(style, dash, depthTest, opacity));
      if (dash) drawn.computeLineDistances();
      drawn.renderOrder = depthTest ? 4 : 3;
      group.add(drawn);
    }
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
      const material = node.material as Material | Material[];
      for (const m of Array.isArray(material) ? material : [material]) {
        if (!m.userData.kept) m.dispose();
      }
    }
  });
  group.clear();
}
