import { describe, expect, it } from "vitest";

import type { CameraAnswer, JobReport } from "../api/types";
import {
  cameraLabel,
  cameraMark,
  costOf,
  healthOf,
  intoBase,
  looksAt,
  pairProgress,
  requestOf,
  shareOf,
  withCameraNames,
} from "./cameras";

const camera = (name: string, change: Partial<CameraAnswer> = {}): CameraAnswer => ({
  name,
  kind: name.startsWith("nav") ? "navcam" : "hazcam",
  link: "chassis",
  size_px: [1024, 768],
  baseline_m: 0.2,
  position_m: [0, 0, 0],
  azimuth_rad: 0,
  elevation_rad: 0,
  field_of_view_rad: Math.PI / 2,
  range_m: [1, 10],
  raw_bytes: 2 * 1024 * 768,
  downlink_s: null,
  ...change,
});

const job = (doing: string, change: Partial<JobReport> = {}): JobReport => ({
  id: "j",
  kind: "reconstruction",
  state: "running",
  progress: 0.4,
  doing,
  ...change,
});

const wish = {
  detail: "near",
  region: "all",
  resolution_m: 0.05,
  keepPrior: true,
  anew: false,
} as const;

describe("what asking pairs costs", () => {
  it("goes by the area of their images and the rate of the link", () => {
    const both = [camera("nav1"), camera("haz1")];
    expect(costOf(both, "full", 1e6)).toEqual({ bytes: 3145728, link_s: 25.165824 });
    expect(costOf(both, "half", null)).toEqual({ bytes: 786432, link_s: null });
    // One at half size, one whole: 1/4 + 1 of a pair.
    expect(costOf(both, "near", null).bytes).toBe(1.25 * 1572864);
  });

  it("asks fine near and coarse far by the sizes of single pairs", () => {
    const places = { rover: [1, 2] as [number, number], pick: null };
    const all = requestOf([camera("nav1"), camera("haz1")], wish, places);
    expect(all).toMatchObject({ cameras: ["nav1", "haz1"], scale: 0.5, scales: { haz1: 1 } });
    expect(all.region).toBeUndefined();
    const near = requestOf([camera("nav1")], { ...wish, region: "rover" }, places);
    expect(near.region).toEqual({ center_m: [1, 2], radius_m: 4 });
    expect(requestOf([camera("nav1")], { ...wish, region: "pick" }, places).region).toBeUndefined();
  });
});

describe("where a pair looks", () => {
  it("has what lies within its angles and range", () => {
    const ahead = camera("nav1");
    expect(looksAt(ahead, [5, 0, 0])).toBe(true);
    expect(looksAt(ahead, [5, 4.9, 0])).toBe(true);
    expect(looksAt(ahead, [5, 5.1, 0])).toBe(false);
    // Three quarters as high as wide.
    expect(looksAt(ahead, [4, 0, 2.9])).toBe(true);
    expect(looksAt(ahead, [4, 0, -3.1])).toBe(false);
    expect(looksAt(ahead, [0.9, 0, 0])).toBe(false);
    expect(looksAt(ahead, [10.1, 0, 0])).toBe(false);
    expect(looksAt(ahead, [-5, 0, 0])).toBe(false);
    const left = camera("nav2", { azimuth_rad: Math.PI / 2, elevation_rad: -Math.PI / 4 });
    expect(looksAt(left, [0, 3, -3])).toBe(true);
    expect(looksAt(left, [0, 3, 3])).toBe(false);
    expect(looksAt(left, [0, -3, -3])).toBe(false);
  });

  it("takes points into the frame of a turned base", () => {
    const half = Math.SQRT1_2;
    const base = {
      position_m: [1, 2, 3] as [number, number, number],
      orientation_xyzw: [0, 0, half, half] as [number, number, number, number],
    };
    // The base looks along y of the world: what is ahead there is on its x axis.
    const [x, y, z] = intoBase(base, [1, 5, 3.5]);
    expect(x).toBeCloseTo(3);
    expect(y).toBeCloseTo(0);
    expect(z).toBeCloseTo(0.5);
  });
});

describe("how far pairs are", () => {
  it("is as told where it is told", () => {
    const told = [{ pair: "nav1", stage: "on_the_way", fraction: 0.5 } as const];
    expect(pairProgress(job("x", { pairs: told }), ["nav1"])).toBe(told);
    expect(shareOf(told[0]!)).toBeCloseTo(1.5 / 4);
    expect(shareOf({ pair: "", stage: "fused", fraction: 0 })).toBe(1);
    expect(shareOf({ pair: "", stage: "failed", fraction: 0.7 })).toBe(0);
  });

  it("is read from what the job does where it is not", () => {
    const stages = (doing: string) =>
      pairProgress(job(doing), ["nav1", "haz1", "nav2"]).map((p) => p.stage);
    expect(stages("waits for its turn")).toEqual(["requested", "requested", "requested"]);
    expect(stages("haz1: matching")).toEqual(["fused", "received", "requested"]);
    expect(stages("judges the ground")).toEqual(["fused", "fused", "fused"]);
    expect(pairProgress(null, ["nav1"])).toEqual([
      { pair: "nav1", stage: "requested", fraction: 0 },
    ]);
  });
});

describe("words", () => {
  it("name pairs", () => {
    expect([cameraLabel("nav1"), cameraLabel("haz3"), cameraLabel("mast")]).toEqual([
      "NavCam 1",
      "HazCam 3",
      "mast",
    ]);
    expect(withCameraNames("added nav1, haz2 and mast1")).toBe(
      "added NavCam 1, HazCam 2 and mast1",
    );
    expect([cameraMark("nav1"), cameraMark("haz12"), cameraMark("mast")]).toEqual([
      "N1",
      "H12",
      "mas",
    ]);
  });

  it("judge a pair by its rows first", () => {
    const grade = (epipolar_px: number | null, fill: number) =>
      healthOf({ epipolar_px, fill }).grade;
    expect(grade(0.1, 0.5)).toBe("normal");
    expect(grade(0.1, 0.1)).toBe("caution");
    expect(grade(0.6, 0.9)).toBe("caution");
    expect(grade(1.2, 0.9)).toBe("serious");
    expect(grade(null, 0.9)).toBe("caution");
  });
});
