// Where the wheels are as last reported; works without the 3-D picture.

import type { URDFRobot } from "urdf-loader";

import type { RoverState, Vec3 } from "../api/types";
import { poseRobot, readUrdf, wheelCenter } from "../scene/urdf";
import { useConsole } from "./console";

let known: { urdf: string; robot: URDFRobot } | null = null;

/** Center of a leg's wheel in `world` (m), or null before the model is there. */
export function wheelOf(leg: string, state: RoverState): Vec3 | null {
  const { model, urdf } = useConsole.getState();
  if (!model || urdf === null) return null;
  if (known?.urdf !== urdf) {
    try {
      known = { urdf, robot: readUrdf(urdf) };
    } catch {
      return null;
    }
  }
  poseRobot(known.robot, model, state);
  return wheelCenter(known.robot, model, leg);
}
