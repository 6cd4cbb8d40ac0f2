import { describe, expect, it } from "vitest";

import type { CoverageAnswer } from "../api/types";
import { coverageRaster, hiddenByLegs } from "./coverage";

const base64 = (bytes: number[]) => btoa(String.fromCharCode(...bytes));

const answer = (change: Partial<CoverageAnswer> = {}): CoverageAnswer => ({
  terrain_version: "v",
  origin_m: [1, 2],
  resolution_m: 0.1,
  size: [3, 2],
  mask_base64: base64([0, 0, 1, 0, 3, 0, 0, 1, 128, 128, 0, 0]),
  hidden_base64: base64([0, 0, 0, 0, 0, 2]),
  cameras: [],
  hidden: [
    { by: "chassis", area_m2: 3, place_m: [0, 0] },
    { by: "leg3", area_m2: 0.4, place_m: [1, 2] },
    { by: "leg1", area_m2: 0.01, place_m: [1, 2] },
  ],
  seen_share: 0.5,
  raw_bytes: 1,
  downlink_s: null,
  cost: { bytes: 1, downlink_s: null, total_s: 1 },
  ...change,
});

describe("coverage", () => {
  it("counts the pairs of each node, and what hides it where there is none", () => {
    const raster = coverageRaster(answer())!;
    expect([...raster.classes]).toEqual([0, 1, 2, 1, 2, 3]);
    expect(raster).toMatchObject({ origin_m: [1, 2], resolution_m: 0.1, size: [3, 2] });
  });

  it("is none where the masks are cut off", () => {
    expect(coverageRaster(answer({ size: [3, 3] }))).toBeNull();
    expect(coverageRaster(answer({ hidden_base64: base64([0]) }))).toBeNull();
  });

  it("names what legs hide, if it is enough to matter", () => {
    expect(hiddenByLegs(answer(), ["leg1", "leg3"]).map((h) => h.by)).toEqual(["leg3"]);
  });
});
