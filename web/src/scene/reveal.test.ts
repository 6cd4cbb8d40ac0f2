import { Vector3 } from "three";
import { describe, expect, it } from "vitest";

import { placesTowards } from "./reveal";

describe("turning the camera to a leg", () => {
  const target = new Vector3(1, 2, 0.5);
  const camera = new Vector3(1, -4, 4);

  it("begins where the camera is and ends on the leg's side", () => {
    const places = placesTowards(camera, target, new Vector3(1, 9, 0));
    expect(places[0]!.distanceTo(camera)).toBeLessThan(1e-9);
    expect(places.at(-1)!.distanceTo(new Vector3(1, 8, 4))).toBeLessThan(1e-9);
  });

  it("keeps height and distance all the way", () => {
    for (const place of placesTowards(camera, target, new Vector3(-3, 5, 0))) {
      expect(place.z).toBe(4);
      expect(place.distanceTo(target)).toBeCloseTo(camera.distanceTo(target), 9);
    }
  });

  it("turns the short way round", () => {
    const places = placesTowards(camera, target, new Vector3(9, 2, 0));
    expect(places.at(-1)!.distanceTo(new Vector3(7, 2, 4))).toBeLessThan(1e-9);
    expect(Math.min(...places.map((p) => p.x))).toBeGreaterThanOrEqual(1 - 1e-9);
  });
});
