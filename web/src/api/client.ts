// One function per route of the server. Errors are `ApiError` with the server's code and sentence.

import type {
  AuthorityReport,
  CamerasAnswer,
  CellAnswer,
  CellExplanation,
  CommandList,
  CommandRecord,
  CoverageAnswer,
  DryRun,
  ErrorInfo,
  EstopAnswer,
  ImportRequest,
  JobReport,
  LinkChange,
  LinkPreset,
  LinkReport,
  LogList,
  PlanAnalysis,
  PlanAnswer,
  PlanRequest,
  PostureAnswer,
  PosturePlanRequest,
  PostureRequest,
  ReachSummary,
  ReconstructionAnswer,
  ReconstructionRequest,
  ReplayChange,
  ReplayMargins,
  ReplayState,
  RoverAnswer,
  Scene,
  StabilityAnswer,
  StabilityPreference,
  StabilityRequest,
  StageRequest,
  OverlayAnswer,
  OverlayList,
  TerrainFiles,
  TerrainVersion,
  TerrainVersions,
  TextureAnswer,
  Vec3,
} from "./types";

const BASE = "/api/v1";

export class ApiError extends Error {
  constructor(
    readonly status: number,
    readonly info: ErrorInfo,
  ) {
    super(info.message);
  }
}

/** The sentence to show for anything that was thrown. */
export function sentenceOf(error: unknown): string {
  if (error instanceof ApiError) return error.message;
  if (error instanceof TypeError) return "The ground server did not answer.";
  return error instanceof Error ? error.message : String(error);
}

let operator = "operator";

/** Whose name goes with every request. */
export function setOperator(name: string): void {
  // Header values carry Latin-1 only; anything else would make every request throw.
  operator = name.replace(/[^\x20-\x7e]/g, "").trim() || "operator";
}

async function errorOf(response: Response): Promise<ApiError> {
  const fallback: ErrorInfo = {
    code: "http_" + response.status,
    message: `The server answered ${response.status} ${response.statusText}.`,
  };
  try {
    const body = (await response.json()) as { error?: ErrorInfo };
    return new ApiError(response.status, body.error?.message ? body.error : fallback);
  } catch {
    return new ApiError(response.status, fallback);
  }
}

async function send(path: string, init: RequestInit = {}): Promise<Response> {
  const headers = new Headers(init.headers);
  headers.set("X-Operator", operator);
  const response = await fetch(path.startsWith("/") ? path : `${BASE}/${path}`, {
    ...init,
    headers,
  });
  if (!response.ok) throw await errorOf(response);
  return response;
}

async function json<T>(
  method: string,
  path: string,
  body?: unknown,
  signal?: AbortSignal,
  headers: Record<string, string> = {},
) {
  const response = await send(path, {
    method,
    signal: signal ?? null,
    ...(body === undefined
      ? { headers }
      : {
          body: JSON.stringify(body),
          headers: { ...headers, "Content-Type": "application/json" },
        }),
  });
  const text = await response.text();
  return (text === "" ? undefined : JSON.parse(text)) as T;
}

async function bytes(path: string, init: RequestInit = {}): Promise<ArrayBuffer> {
  return (await send(path, init)).arrayBuffer();
}

const part = encodeURIComponent;

export const api = {
  rover: () => json<RoverAnswer>("GET", "rover"),
  urdf: async (robot: string) => (await send(`robots/${part(robot)}/urdf`)).text(),

  terrainVersions: () => json<TerrainVersions>("GET", "terrain/versions"),
  tile: (version: string, layer: string, x: number, y: number, signal?: AbortSignal) =>
    bytes(`terrain/${part(version)}/tiles/${layer}/0/${x}/${y}`, { signal: signal ?? null }),
  cell: (version: string, x_m: number, y_m: number, signal?: AbortSignal) =>
    json<CellAnswer>(
      "GET",
      `terrain/${part(version)}/cell?x_m=${x_m.toFixed(3)}&y_m=${y_m.toFixed(3)}`,
      undefined,
      signal,
    ),
  terrainFiles: () => json<TerrainFiles>("GET", "terrain/files"),
  putTerrainFile: async (name: string, file: Blob) => {
    await send(`terrain/files/${part(name)}`, { method: "PUT", body: file });
  },
  texture: (version: string, signal: AbortSignal) =>
    json<TextureAnswer>("GET", `terrain/${part(version)}/texture`, undefined, signal),
  textureTile: (version: string, x: number, y: number, signal: AbortSignal) =>
    bytes(`terrain/${part(version)}/texture/${x}/${y}`, { signal }),
  rasters: () => json<OverlayList>("GET", "terrain/overlays"),
  addRaster: (file: string) => json<OverlayAnswer>("POST", "terrain/overlays", { file }),
  removeRaster: (id: string) => json<undefined>("DELETE", `terrain/overlays/${part(id)}`),
  rasterTile: (id: string, x: number, y: number, signal: AbortSignal) =>
    bytes(`terrain/overlays/${part(id)}/${x}/${y}`, { signal }),
  exportOf: (version: string, format: string, error_m: number) =>
    `${BASE}/terrain/${part(version)}/export?format=${format}&error_m=${error_m}`,
  importTerrain: (request: ImportRequest) => json<JobReport>("POST", "terrain/imports", request),

  cameras: () => json<CamerasAnswer>("GET", "rover/cameras"),
  coverage: (cameras: string[], signal: AbortSignal) =>
    json<CoverageAnswer>("POST", "rover/cameras/coverage", { cameras }, signal),
  reconstruct: (request: ReconstructionRequest) =>
    json<JobReport>("POST", "terrain/reconstructions", request),
  reconstruction: (path: string) => json<ReconstructionAnswer>("GET", path),
  selectVersion: (version: string) =>
    json<TerrainVersion>("POST", `terrain/versions/${part(version)}/select`),
  removePair: (version: string, source: number) =>
    json<TerrainVersion>("DELETE", `terrain/${part(version)}/pairs/${source}`),
  fitPair: (version: string, source: number, fitted: boolean) =>
    json<TerrainVersion>("PUT", `terrain/${part(version)}/pairs/${source}/fit`, { fitted }),
  pictureOf: (reconstruction: string, pair: string, picture: string) =>
    `${BASE}/terrain/reconstructions/${part(reconstruction)}/pairs/${part(pair)}/${picture}.png`,

  stability: (request: StabilityRequest, signal: AbortSignal) =>
    json<StabilityAnswer>("POST", "analysis/stability", request, signal),
  reachability: (
    leg: string,
    stability: StabilityPreference,
    scene: Scene | undefined,
    signal: AbortSignal,
  ) =>
    bytes("analysis/reachability", {
      method: "POST",
      signal,
      headers: { "Content-Type": "application/json", Accept: "application/octet-stream" },
      // Cells and lift are the server's defaults: they go with the robot's scale, as those of plans.
      body: JSON.stringify({ legs: [leg], stability, scene }),
    }),

  explainCell: (
    leg: string,
    [x, y]: Vec3,
    stability: StabilityPreference,
    scene: Scene | undefined,
    signal: AbortSignal,
  ) =>
    json<CellExplanation>(
      "POST",
      "analysis/reachability/cell",
      { leg, position_m: [x, y], stability, scene },
      signal,
    ),

  liveReach: () => json<ReachSummary>("GET", "rover/reachability"),
  preferReach: (stability: StabilityPreference) =>
    json<ReachSummary>("PUT", "rover/reachability", { stability }),
  liveCells: (leg: string) => bytes(`rover/reachability/${part(leg)}`, { cache: "no-store" }),
  planToCells: (leg: string) => json<JobReport>("POST", `rover/reachability/${part(leg)}/plans`),

  postureAtOnce: (request: PostureRequest, signal: AbortSignal) =>
    json<PostureAnswer>("POST", "analysis/posture", request, signal),
  posture: (request: PostureRequest) => json<JobReport>("POST", "rover/posture", request),
  postureResult: (path: string) => json<PostureAnswer>("GET", path),
  planPosture: (id: string, taken: PosturePlanRequest) =>
    json<PlanAnswer>("POST", `rover/posture/${part(id)}/plans`, taken),

  planAtOnce: (request: PlanRequest, signal: AbortSignal) =>
    json<PlanAnalysis>("POST", "analysis/plan", request, signal),
  plan: (request: PlanRequest) => json<JobReport>("POST", "plans", request),
  job: (id: string) => json<JobReport>("GET", `jobs/${part(id)}`),
  cancelJob: (id: string) => json<unknown>("DELETE", `jobs/${part(id)}`),
  planResult: (path: string) => json<PlanAnswer>("GET", path),

  commands: () => json<CommandList>("GET", "commands"),
  stage: (request: StageRequest) => json<CommandRecord>("POST", "commands", request),
  arm: (id: string) => json<CommandRecord>("POST", `commands/${part(id)}/arm`, {}),
  sendCommand: (id: string) => json<CommandRecord>("POST", `commands/${part(id)}/send`, {}),
  cancelCommand: (id: string) => json<CommandRecord>("POST", `commands/${part(id)}/cancel`, {}),

  approveCommand: (id: string, content_hash: string) =>
    json<CommandRecord>("POST", `commands/${part(id)}/approve`, { content_hash }),
  resolveCommand: (id: string, done: boolean, why: string) =>
    json<CommandRecord>("POST", `commands/${part(id)}/resolve`, { done, why }),
  checkCommand: (request: StageRequest) => json<DryRun>("POST", "commands/checks", request),

  acquireAuthority: (take_over: boolean) =>
    json<AuthorityReport>("POST", "authority/acquire", { take_over }),
  renewAuthority: () => json<AuthorityReport>("POST", "authority/renew"),
  requestAuthority: () => json<AuthorityReport>("POST", "authority/request"),
  handOverAuthority: (to: string) => json<AuthorityReport>("POST", "authority/hand-over", { to }),
  releaseAuthority: () => json<AuthorityReport>("POST", "authority/release"),

  estop: () => json<EstopAnswer>("POST", "estop", {}),
  releaseEstop: (token?: string) =>
    json<EstopAnswer>("POST", "estop/release", token === undefined ? {} : { token }),

  linkPresets: () => json<LinkPreset[]>("GET", "link/presets"),
  putLink: (config: LinkChange) => json<LinkReport>("PUT", "link", config),

  logs: () => json<LogList>("GET", "logs"),
  /** A long log takes its time: it is opened by a job. */
  startReplay: (log: string, rate: number) =>
    json<JobReport>("POST", "replays", { log, rate }, undefined, { Prefer: "respond-async" }),
  replayResult: (path: string) => json<ReplayState>("GET", path),
  changeReplay: (id: string, change: ReplayChange) =>
    json<ReplayState>("PATCH", `replays/${part(id)}`, change),
  /** How the margins went before the place where it is. */
  replayMargins: (id: string) => json<ReplayMargins>("GET", `replays/${part(id)}/margins`),
  endReplay: (id: string) => json<unknown>("DELETE", `replays/${part(id)}`),
};
