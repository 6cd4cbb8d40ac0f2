// Stereo pairs before they are asked: where they look, what asking them costs, how far each is.

import type {
  CameraAnswer,
  JobReport,
  PairProgress,
  PairStage,
  Pose,
  Quat,
  ReconstructionRequest,
  Vec2,
  Vec3,
} from "../api/types";

/** How fine the images are: by kind of pair, as a share of the pairs' own size. */
export type Detail = "quick" | "half" | "near" | "full";

const SCALES: Record<Detail, { near: number; far: number }> = {
  quick: { near: 0.25, far: 0.25 },
  half: { near: 0.5, far: 0.5 },
  near: { near: 1, far: 0.5 },
  full: { near: 1, far: 1 },
};

export function scaleOf(camera: CameraAnswer, detail: Detail): number {
  const scales = SCALES[detail];
  return camera.kind === "navcam" ? scales.far : scales.near;
}

export interface Cost {
  bytes: number;
  /** Time over the link (s); null where it has no limit. */
  link_s: number | null;
}

/** What the images of these pairs weigh, before any compression. */
export function costOf(cameras: CameraAnswer[], detail: Detail, rate_bps: number | null): Cost {
  const bytes = cameras.reduce((sum, c) => sum + c.raw_bytes * scaleOf(c, detail) ** 2, 0);
  return { bytes, link_s: rate_bps === null ? null : (8 * bytes) / rate_bps };
}

/** The ground that is asked for. */
export type Region = "all" | "rover" | "pick";

export interface Wish {
  detail: Detail;
  region: Region;
  resolution_m: number;
  keepPrior: boolean;
  anew: boolean;
}

export const REGION_RADIUS_M: Record<Exclude<Region, "all">, number> = { rover: 4, pick: 1.5 };

export function requestOf(
  cameras: CameraAnswer[],
  wish: Wish,
  places: { rover: Vec2 | null; pick: Vec2 | null },
): ReconstructionRequest {
  const scale = SCALES[wish.detail].far;
  const scales = Object.fromEntries(
    cameras.map((c) => [c.name, scaleOf(c, wish.detail)]).filter(([, s]) => s !== scale),
  ) as Record<string, number>;
  const center = wish.region === "all" ? null : places[wish.region];
  return {
    cameras: cameras.map((c) => c.name),
    resolution_m: wish.resolution_m,
    scale,
    scales,
    keep_prior: wish.keepPrior,
    anew: wish.anew,
    ...(center &&
      wish.region !== "all" && {
        region: { center_m: center, radius_m: REGION_RADIUS_M[wish.region] },
      }),
  };
}

/** A point of `world` in the frame of the base (m). */
export function intoBase(base: Pose, point: Vec3): Vec3 {
  const [x, y, z, w] = base.orientation_xyzw;
  return rotated([-x, -y, -z, w], point.map((v, i) => v - base.position_m[i]!) as Vec3);
}

function rotated([qx, qy, qz, qw]: Quat, v: Vec3): Vec3 {
  const cross = (a: Vec3, b: Vec3): Vec3 => [
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
  ];
  const axis: Vec3 = [qx, qy, qz];
  const once = cross(axis, v).map((c) => 2 * c) as Vec3;
  const twice = cross(axis, once);
  return v.map((c, i) => c + qw * once[i]! + twice[i]!) as Vec3;
}

/** Does a pair that the base carries have a point of the base's frame in its image and range? */
export function looksAt(camera: CameraAnswer, point: Vec3): boolean {
  const way = point.map((v, i) => v - camera.position_m[i]!) as Vec3;
  const [ca, sa] = [Math.cos(camera.azimuth_rad), Math.sin(camera.azimuth_rad)];
  const [ce, se] = [Math.cos(camera.elevation_rad), Math.sin(camera.elevation_rad)];
  const depth = way[0] * ca * ce + way[1] * sa * ce + way[2] * se;
  const right = way[0] * sa - way[1] * ca;
  const up = -way[0] * ca * se - way[1] * sa * se + way[2] * ce;
  const across = Math.tan(camera.field_of_view_rad / 2);
  const along = (across * camera.size_px[1]) / camera.size_px[0];
  return (
    depth >= camera.range_m[0] &&
    depth <= camera.range_m[1] &&
    Math.abs(right) <= depth * across &&
    Math.abs(up) <= depth * along
  );
}

const STAGES: PairStage[] = ["requested", "on_the_way", "received", "matched", "fused"];

export const STAGE_WORDS: Record<PairStage, string> = {
  requested: "asked for",
  on_the_way: "on the way",
  received: "images here",
  matched: "matched",
  fused: "in the map",
  failed: "failed",
};

/** Share of all its work that a pair has behind it, 0 to 1. */
export function shareOf({ stage, fraction }: PairProgress): number {
  const at = STAGES.indexOf(stage);
  if (stage === "fused") return 1;
  return at < 0 ? 0 : Math.min(1, (at + Math.max(0, fraction)) / (STAGES.length - 1));
}

/** What a server that only names the pair at hand says of each: `nav1: matching`. */
const DOING: Record<string, PairStage> = {
  images: "on_the_way",
  matching: "received",
  blending: "matched",
};

/** How far each pair is: as told, else from what the job says it is doing. */
export function pairProgress(job: JobReport | null, names: string[]): PairProgress[] {
  if (job?.pairs?.length) return job.pairs;
  const [name, doing] = job?.doing.split(": ") ?? [];
  const at = names.indexOf(name ?? "");
  const over = job?.state === "done" || job?.doing === "judges the ground";
  return names.map((pair, i) => {
    const stage: PairStage =
      over || i < at ? "fused" : i === at ? (DOING[doing ?? ""] ?? "requested") : "requested";
    return { pair, stage, fraction: 0 };
  });
}

/** `nav1` → `NavCam 1`; other names stay. */
export function cameraLabel(name: string): string {
  return name
    .replace(/^nav(\d+)$/, "NavCam $1")
    .replace(/^haz(\d+)$/, "HazCam $1")
    .replace(/^tool(\d+)$/, "ToolCam $1");
}

/** A sentence of the server with the pairs by their names: `added nav1` → `added NavCam 1`. */
export function withCameraNames(text: string): string {
  return text.replace(/\b(nav|haz|tool)\d+\b/g, cameraLabel);
}

/** Two or three letters for a plan. */
export function cameraMark(name: string): string {
  const found = /^(\p{L})\p{L}*(\d+)$/u.exec(name);
  return found ? `${found[1]!.toUpperCase()}${found[2]}` : name.slice(0, 3);
}

export type Grade = "normal" | "caution" | "serious";

/** What to think of a pair by its rows, its fill and how flat its ground is. */
export function healthOf(pair: { epipolar_px?: number | null; fill: number }): {
  grade: Grade;
  why: string;
} {
  const { epipolar_px: rows, fill } = pair;
  if (rows == null) return { grade: "caution", why: "too few corners to tell whether rows agree" };
  if (rows >= 1) return { grade: "serious", why: "rows are off: calibrate the pair anew" };
  if (rows >= 0.5) return { grade: "caution", why: "rows are off by half a pixel or more" };
  if (fill < 0.2) return { grade: "caution", why: "less than a fifth of the image was matched" };
  return { grade: "normal", why: "rows agree and the image was matched" };
}
