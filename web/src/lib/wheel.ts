import type { Vec3 } from "../api/types";

// The kinematics live with the scene's robot; whoever shows it offers where its wheels are.
let source: (leg: string) => Vec3 | null = () => null;

export function offerWheels(wheel: (leg: string) => Vec3 | null): void {
  source = wheel;
}

/** Center of a leg's wheel as last reported, in `world` (m); null without a picture of the robot. */
export function wheelOf(leg: string): Vec3 | null {
  return source(leg);
}
