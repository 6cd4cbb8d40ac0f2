// Where to put the camera so that a leg can be seen: turned about what it looks at, and no further
// than need be.

import { Vector3 } from "three";

const STEP_RAD = Math.PI / 12;

/**
 * Places of a camera that turns about `target` from where it is until it stands on the side of
 * `towards`, the present one first; its height and distance stay.
 */
export function placesTowards(camera: Vector3, target: Vector3, towards: Vector3): Vector3[] {
  const arm = new Vector3().subVectors(camera, target);
  const from = Math.atan2(arm.y, arm.x);
  const to = Math.atan2(towards.y - target.y, towards.x - target.x);
  const turn = Math.atan2(Math.sin(to - from), Math.cos(to - from));
  const count = Math.ceil(Math.abs(turn) / STEP_RAD);
  const flat = Math.hypot(arm.x, arm.y);
  return Array.from({ length: count + 1 }, (_, i) => {
    const angle = from + (count === 0 ? 0 : (i / count) * turn);
    return new Vector3(
      target.x + flat * Math.cos(angle),
      target.y + flat * Math.sin(angle),
      camera.z,
    );
  });
}
