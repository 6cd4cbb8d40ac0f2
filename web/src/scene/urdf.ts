// The robot from its URDF: primitives only, posed by the joint names of the model.

import {
  type BufferGeometry,
  Group,
  type Material,
  Mesh,
  type Object3D,
  Quaternion,
  Vector3,
} from "three";
import URDFLoader, { type URDFRobot } from "urdf-loader";

import type { RoverModel, RoverState, Vec3 } from "../api/types";

/** Reads a URDF without fetching anything: meshes are left out, capsules become three shapes. */
export function readUrdf(text: string): URDFRobot {
  const document = new DOMParser().parseFromString(text, "application/xml");
  const root = document.documentElement;
  if (root?.nodeName !== "robot") throw new Error("The rover's URDF cannot be read.");
  expandCapsules(document);
  const loader = new URDFLoader();
  loader.parseCollision = false;
  loader.loadMeshCb = (_path, _manager, _material, done) => done(new Group());
  return loader.parse(root);
}

const numbers = (text: string | null) => (text ?? "").trim().split(/\s+/).map(Number);
const triple = (text: string | null): Vec3 => {
  const [x = 0, y = 0, z = 0] = text === null ? [] : numbers(text);
  return [x, y, z];
};

/** Replaces each `<capsule radius length>` by a cylinder and two spheres; urdf-loader knows only those. */
export function expandCapsules(document: Document): void {
  for (const capsule of [...document.getElementsByTagName("capsule")]) {
    const shape = capsule.parentElement?.parentElement;
    if (!shape?.parentElement) continue;
    const radius = Number(capsule.getAttribute("radius"));
    const length = Number(capsule.getAttribute("length"));
    const origin = [...shape.children].find((c) => c.tagName === "origin");
    const xyz = triple(origin?.getAttribute("xyz") ?? null);
    const rpy = triple(origin?.getAttribute("rpy") ?? null);
    const axis = zAxisOf(rpy);
    for (const end of [-1, 1]) {
      const place = xyz.map((v, k) => v + (end * length * axis[k]!) / 2);
      const cap = shape.cloneNode(true) as Element;
      cap.removeAttribute("name");
      const sphere = document.createElement("sphere");
      sphere.setAttribute("radius", String(radius));
      cap.getElementsByTagName("geometry")[0]?.replaceChildren(sphere);
      let at = [...cap.children].find((c) => c.tagName === "origin");
      if (!at) {
        at = document.createElement("origin");
        cap.appendChild(at);
      }
      at.setAttribute("xyz", place.join(" "));
      at.setAttribute("rpy", "0 0 0");
      shape.parentElement.appendChild(cap);
    }
    const cylinder = document.createElement("cylinder");
    cylinder.setAttribute("radius", String(radius));
    cylinder.setAttribute("length", String(length));
    capsule.replaceWith(cylinder);
  }
}

/** Third column of Rz(yaw)·Ry(pitch)·Rx(roll). */
function zAxisOf([r, p, y]: Vec3): Vec3 {
  return [
    Math.cos(y) * Math.sin(p) * Math.cos(r) + Math.sin(y) * Math.sin(r),
    Math.sin(y) * Math.sin(p) * Math.cos(r) - Math.cos(y) * Math.sin(r),
    Math.cos(p) * Math.cos(r),
  ];
}

export type LinkRole = "chassis" | "upper" | "lower" | "wheel";

/** Gives every mesh of the robot a material by what it belongs to: `pick(role, leg, joint)`. */
export function dress(
  robot: URDFRobot,
  model: RoverModel,
  pick: (role: LinkRole, leg: string | null, joint: number) => Material,
): void {
  const owner = new Map<Object3D, [LinkRole, string | null, number]>();
  for (const leg of model.legs) {
    leg.joints.forEach((name, k) => {
      const joint = robot.joints[name];
      if (joint) owner.set(joint, [k < leg.joints.length / 2 ? "upper" : "lower", leg.name, k]);
    });
    const wheel = robot.links[leg.wheel_link] ?? robot.joints[leg.wheel_joint];
    if (wheel) owner.set(wheel, ["wheel", leg.name, leg.joints.length - 1]);
  }
  robot.traverse((node) => {
    if (!(node instanceof Mesh)) return;
    let up: Object3D | null = node;
    while (up && !owner.has(up)) up = up.parent;
    const [role, leg, joint] = (up && owner.get(up)) ?? ["chassis", null, -1];
    const mesh = node as Mesh<BufferGeometry, Material>;
    mesh.material = pick(role, leg, joint);
    mesh.userData.leg = leg;
  });
}

/** Puts the robot where the state says. */
export function poseRobot(robot: URDFRobot, model: RoverModel, state: RoverState): void {
  robot.position.set(...state.base.position_m);
  robot.quaternion.set(...state.base.orientation_xyzw);
  robot.scale.setScalar(model.scale);
  for (const leg of model.legs) {
    poseLeg(robot, model, leg.name, state.joints_rad[leg.name] ?? []);
    robot.setJointValue(leg.wheel_joint, state.wheels_rad?.[leg.name] ?? 0);
  }
  robot.updateMatrixWorld(true);
}

export function poseLeg(
  robot: URDFRobot,
  model: RoverModel,
  leg: string,
  joints_rad: number[],
): void {
  const chain = model.legs.find((l) => l.name === leg);
  chain?.joints.forEach((name, k) => {
    const value = joints_rad[k];
    if (value === undefined) return;
    // Limits are the server's business; here the picture must show what was reported.
    const joint = robot.joints[name];
    if (joint) joint.ignoreLimits = true;
    robot.setJointValue(name, value);
  });
}

const scratch = new Vector3();

/** Center of a leg's wheel in `world` (m). */
export function wheelCenter(robot: URDFRobot, model: RoverModel, leg: string): Vec3 | null {
  const chain = model.legs.find((l) => l.name === leg);
  const node = chain && (robot.links[chain.wheel_link] ?? robot.joints[chain.wheel_joint]);
  if (!node) return null;
  node.getWorldPosition(scratch);
  return [scratch.x, scratch.y, scratch.z];
}

/** Joints of a leg from the hip to the wheel as points in `world` (m): for picking it. */
export function legPoints(robot: URDFRobot, model: RoverModel, leg: string): Vec3[] {
  const chain = model.legs.find((l) => l.name === leg);
  if (!chain) return [];
  return [...chain.joints, chain.wheel_joint].flatMap((name) => {
    const joint = robot.joints[name];
    if (!joint) return [];
    joint.getWorldPosition(scratch);
    return [[scratch.x, scratch.y, scratch.z] as Vec3];
  });
}

/** World quaternion of the base, for the leg view. */
export function baseRotation(state: RoverState): Quaternion {
  return new Quaternion(...state.base.orientation_xyzw);
}
