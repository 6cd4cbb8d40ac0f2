// The robot three times: as reported (solid), as predicted now (hatched), as planned (ghost).

import {
  BoxGeometry,
  Color,
  Group,
  type Material,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  MeshStandardMaterial,
  type Object3D,
  Raycaster,
  Vector3,
} from "three";
import type { URDFRobot } from "urdf-loader";

import type { RoverModel, RoverState, Vec3 } from "../api/types";
import type { PlanPose } from "../lib/pose";
import { hatchable, type HatchUniform } from "./hatch";
import { dress, legPoints, type LinkRole, poseLeg, poseRobot, readUrdf, wheelCenter } from "./urdf";
import type { LegShape } from "./legPick";

const COLORS: Record<LinkRole, string> = {
  chassis: "#c9ccd1",
  upper: "#9aa3ad",
  lower: "#b9b4aa",
  wheel: "#3a4048",
};
const PAYLOAD_COLOR = "#b08d5a";
const ACCENT = "#5aa9ff";
/** Torque colours: quiet below half, yellow to the limit's four fifths, red beyond. */
const TORQUE: [number, string][] = [
  [0.5, "#5fb47a"],
  [0.8, "#d8bf52"],
  [Infinity, "#d1584f"],
];

type Solid = MeshLambertMaterial | MeshStandardMaterial;

export class RobotView {
  readonly group = new Group();
  private robot: URDFRobot;
  private ghost: URDFRobot;
  private predicted: URDFRobot;
  private readonly stale: HatchUniform = { value: 0 };
  private readonly materials = new Map<string, Solid>();
  private readonly extra: Material[] = [];
  private state: RoverState | null = null;
  private chosen: string | null = null;
  private torques = false;
  private readonly ghostOfLeg: Material;
  private readonly ghostOfRest: Material;
  private ghostLeg: string | null = null;
  private ghostWhole = false;
  private soft = false;
  private predictedShown = "";

  constructor(
    readonly model: RoverModel,
    urdf: string,
    private readonly plain: boolean,
  ) {
    this.robot = readUrdf(urdf);
    this.ghost = this.robot.clone();
    this.predicted = this.robot.clone();
    this.addPayloads();
    dress(this.robot, model, (role, leg, joint) => this.material(role, leg, joint));
    this.robot.traverse((node) => {
      node.castShadow = true;
    });
    this.ghostOfLeg = this.keep(ghostly(0.5));
    this.ghostOfRest = this.keep(ghostly(0.28));
    dress(this.ghost, model, () => this.ghostOfLeg);
    const now = this.keep(
      hatchable(new MeshBasicMaterial({ color: "#dfe7ef", transparent: true, opacity: 0.45 }), {
        value: 1,
      }),
    );
    dress(this.predicted, model, () => now);
    this.robot.visible = this.ghost.visible = this.predicted.visible = false;
    this.group.add(this.robot, this.ghost, this.predicted);
  }

  setState(state: RoverState): void {
    this.state = state;
    poseRobot(this.robot, this.model, state);
    this.robot.visible = true;
  }

  setStale(stale: boolean): void {
    this.stale.value = stale ? 1 : 0;
  }

  highlight(leg: string | null): void {
    this.chosen = leg;
    for (const [key, material] of this.materials) {
      const mine = leg !== null && key.includes(`|${leg}|`);
      // Torque colours must stay readable on the chosen leg, and the ghost must stand out from it.
      const strength = this.torques || this.soft ? 0.16 : 0.42;
      material.emissive.set(mine ? ACCENT : "#000000").multiplyScalar(mine ? strength : 0);
    }
  }

  /** Colours of the joints by torque / limit, or the plain ones. */
  setTorques(ratios: Record<string, number[]> | null): void {
    this.torques = ratios !== null;
    this.highlight(this.chosen);
    for (const [key, material] of this.materials) {
      const [role, leg = "", joint = "0"] = key.split("|") as [LinkRole, string, string];
      const ratio = role === "wheel" ? undefined : ratios?.[leg]?.[Number(joint)];
      const color = TORQUE.find(([limit]) => Math.abs(ratio ?? 0) < limit)?.[1];
      material.color.set(ratio === undefined || !color ? COLORS[role] : color);
    }
  }

  /** Lights the chosen leg but faintly, so that its ghost stands out from it. */
  setSoft(soft: boolean): void {
    if (soft === this.soft) return;
    this.soft = soft;
    this.highlight(this.chosen);
  }

  /** The planned pose: the leg alone, or the whole rover where its body is shifted; dim where old. */
  setGhost(pose: PlanPose | null, dim = false): void {
    const leg = pose?.leg ?? null;
    const whole = pose?.stance != null;
    if (leg !== this.ghostLeg || whole !== this.ghostWhole) {
      this.ghostLeg = leg;
      this.ghostWhole = whole;
      this.ghost.traverse((node) => {
        if (!(node instanceof Mesh)) return;
        const own = node.userData.leg === leg;
        node.visible = own || whole;
        node.material = own ? this.ghostOfLeg : this.ghostOfRest;
      });
    }
    this.ghostOfLeg.opacity = dim ? 0.25 : 0.5;
    this.ghostOfRest.opacity = dim ? 0.12 : 0.28;
    this.poseOther(this.ghost, leg, pose?.joints_rad ?? [], pose?.stance);
  }

  /** The pose guessed for now: the leg alone, or the whole rover while its body shifts. */
  setPredicted(pose: PlanPose | null): void {
    const leg = pose?.leg ?? null;
    const shown = pose?.stance ? "*" : (leg ?? "");
    if (shown !== this.predictedShown) this.only(this.predicted, pose?.stance ? null : leg);
    this.predictedShown = shown;
    this.poseOther(this.predicted, leg, pose?.joints_rad ?? [], pose?.stance);
  }

  /** Centers of the stepping leg's wheel for a row of poses; the ghost is to be set anew after it. */
  trace(path: PlanPose[]): Vec3[] {
    if (!this.state) return [];
    poseRobot(this.ghost, this.model, this.state);
    return path.flatMap(({ leg, joints_rad, stance }) => {
      if (stance) poseRobot(this.ghost, this.model, stance);
      else poseLeg(this.ghost, this.model, leg, joints_rad);
      this.ghost.updateMatrixWorld(true);
      const center = wheelCenter(this.ghost, this.model, leg);
      return center ? [center] : [];
    });
  }

  wheel(leg: string): Vec3 | null {
    return wheelCenter(this.robot, this.model, leg);
  }

  /** Center of the planned wheel, where a plan is drawn. */
  ghostWheel(): Vec3 | null {
    return this.ghostLeg === null ? null : wheelCenter(this.ghost, this.model, this.ghostLeg);
  }

  /** Is most of a leg behind other parts of the rover, seen from a place in `world`? */
  hides(leg: string, from: Vector3): boolean {
    const inTheWay: Object3D[] = [];
    this.robot.traverse((node) => {
      if (node instanceof Mesh && node.userData.leg !== leg) inTheWay.push(node);
    });
    const points = legPoints(this.robot, this.model, leg);
    // What hangs at the hip is near the chassis from everywhere: the outer half decides.
    const outer = points.slice(Math.floor(points.length / 2));
    const hidden = outer.map((point) => {
      const way = new Vector3(...point).sub(from);
      const caster = new Raycaster(from, way.clone().normalize(), 0, way.length());
      return caster.intersectObjects(inTheWay, false).length > 0;
    });
    const wheelHidden = hidden.at(-1) ?? false;
    return wheelHidden || hidden.filter(Boolean).length > outer.length / 2;
  }

  legShapes(): LegShape[] {
    return this.model.legs.map((l) => ({
      leg: l.name,
      points: legPoints(this.robot, this.model, l.name),
      wheel_radius_m: l.wheel_radius_m * 1.15,
    }));
  }

  dispose(): void {
    for (const material of [...this.materials.values(), ...this.extra]) material.dispose();
    this.group.traverse((node) => {
      if (node instanceof Mesh) node.geometry.dispose();
    });
  }

  private poseOther(
    robot: URDFRobot,
    leg: string | null,
    joints_rad: number[],
    stance: RoverState | null = null,
  ): void {
    const state = stance ?? this.state;
    robot.visible = leg !== null && state !== null;
    if (leg === null || !state) return;
    poseRobot(robot, this.model, state);
    poseLeg(robot, this.model, leg, joints_rad);
    robot.updateMatrixWorld(true);
  }

  /** Leaves only one leg of a robot to be seen; all of it where none is given. */
  private only(robot: URDFRobot, leg: string | null): void {
    robot.traverse((node: Object3D) => {
      if (node instanceof Mesh) node.visible = leg === null || node.userData.leg === leg;
    });
  }

  private addPayloads(): void {
    for (const payload of this.model.payloads) {
      const link = this.robot.links[payload.link];
      if (!payload.shape || !link) continue;
      const box = new Mesh(new BoxGeometry(...payload.shape.box_m));
      // Payloads are given at the scale that the rover has, links at that of its folder.
      const inverse = 1 / this.model.scale;
      box.scale.setScalar(inverse);
      box.position.set(...payload.com_m).multiplyScalar(inverse);
      box.name = "payload";
      link.add(box);
    }
  }

  private material(role: LinkRole, leg: string | null, joint: number): Material {
    const key = `${role}|${leg ?? ""}|${joint}`;
    const known = this.materials.get(key);
    if (known) return known;
    const color = COLORS[role];
    const solid = this.plain
      ? new MeshLambertMaterial({ color })
      : new MeshStandardMaterial({
          color,
          roughness: role === "wheel" ? 0.85 : 0.55,
          metalness: 0.15,
        });
    this.materials.set(key, hatchable(solid, this.stale));
    return solid;
  }

  /** Payload boxes get their own colour after the links were dressed. */
  dressPayloads(): void {
    const material = this.keep(
      hatchable(new MeshLambertMaterial({ color: PAYLOAD_COLOR }), this.stale),
    );
    this.robot.traverse((node) => {
      if (node instanceof Mesh && node.name === "payload") node.material = material;
    });
  }

  private keep<M extends Material>(material: M): M {
    this.extra.push(material);
    return material;
  }
}

function ghostly(opacity: number): Material {
  return new MeshLambertMaterial({
    color: ACCENT,
    emissive: new Color(ACCENT).multiplyScalar(0.25),
    transparent: true,
    opacity,
    depthWrite: false,
  });
}
