// The messages of the server, by short names. Their fields come from `schema.d.ts`, which
// `npm run generate` writes from the server's OpenAPI document (openapi.json); here only the lengths of arrays
// are added, which that document does not tell, and what the stream carries as its message.
// SI units, radians, RFC 3339 times.

import type { components } from "./schema";

export type Vec2 = [number, number];
export type Vec3 = [number, number, number];
export type Quat = [number, number, number, number];

/** Fields whose arrays have a known length wherever they occur. */
interface Lengths {
  position_m: Vec3;
  orientation_xyzw: Quat;
  com_m: Vec3;
  normal: Vec3;
  ground_m: Vec3;
  target_m: Vec3;
  nearest_m: Vec3;
  box_m: Vec3;
  frame_offset_m: Vec3;
  polygon_m: Vec2[];
  critical_edge_m: [Vec2, Vec2];
  limits_rad: Vec2[];
  origin_m: Vec2;
  size: Vec2;
  tiles: Vec2;
  z_range_m: Vec2;
  center_m: Vec2;
  place_m: Vec2;
  contact_points_m: Record<string, Vec3>;
  wheel_forces_n: Record<string, Vec3>;
  contact_forces_n: Record<string, Vec3>;
  load_share_n: Record<string, Vec3>;
  center_of_force_m: Vec2;
  energy_edge: [string, string];
  size_px: Vec2;
  range_m: Vec2;
}

type Sized<T> = T extends (infer Item)[]
  ? Sized<Item>[]
  : T extends object
    ? { [K in keyof T]: SizedField<K, T[K]> }
    : T;

/** A `size` may also be a number of bytes: only arrays are given a length. */
type SizedField<K, T> = K extends keyof Lengths
  ? Extract<T, object> extends never
    ? T
    : Lengths[K] | Extract<T, null | undefined>
  : Sized<T>;

type Schemas = components["schemas"];
type Wire<Name extends keyof Schemas> = Sized<Schemas[Name]>;

export type Pose = Wire<"Pose">;
export type RoverState = Wire<"RoverState">;
export type RoverTelemetry = Wire<"RoverTelemetry">;
export type RoverModel = Wire<"RoverModel">;
export type LegModel = Wire<"LegModel">;
export type RoverAnswer = Wire<"RoverAnswer">;
export type PolygonAnswer = Wire<"PolygonAnswer">;
export type StabilityDerived = Wire<"StabilityDerived">;
export type CellExplanation = Wire<"CellExplanation">;
export type StabilityRequest = Wire<"StabilityRequest">;
export type StabilityAnswer = Wire<"StabilityAnswer">;
export type EnergySurface = Wire<"EnergySurface">;
export type StabilityPreference = Wire<"StabilityPreference">;

export type Scene = Wire<"Scene">;
export type EnergySlice = Wire<"EnergySlice">;
export type CellMend = Wire<"CellMend">;
export type ReachSummary = Wire<"ReachSummary">;

export type PostureRequest = Wire<"PostureRequest">;
export type PostureAnswer = Wire<"PostureAnswer">;
export type PostureAdvice = Wire<"PostureAdvice">;
export type PostureProposal = Wire<"PostureProposal">;
export type PosturePlanRequest = Wire<"PosturePlanRequest">;
export type PostureAccident = Wire<"PostureAccident">;
export type PostureMargins = Wire<"PostureMargins">;
export type PostureBarrier = Wire<"PostureBarrier">;
export type PostureAccidents = Wire<"PostureAccidents">;
export type PostureAftermath = Wire<"PostureAftermath">;
export type PlanPosture = Wire<"PlanPosture">;

export type CommandBody = Wire<"CommandBody">;
export type CommandState = Wire<"CommandState">;
export type CommandRecord = Wire<"CommandRecord">;
export type CommandEvent = Wire<"CommandEvent">;
export type CommandList = Wire<"CommandList">;
export type PlanCommandRef = Wire<"PlanCommandRef">;
export type StageRequest = Wire<"StageRequest">;
export type EstopAnswer = Wire<"EstopAnswer">;

export type AuthorityReport = Wire<"AuthorityReport">;
export type Precondition = Wire<"Precondition">;
export type DryRun = Wire<"DryRun">;

export type LinkPreset = Wire<"LinkPreset">;
export type QueueFill = Wire<"QueueFill">;
export type LinkConfig = Wire<"LinkConfig">;
export type DirectionModel = NonNullable<LinkConfig["up"]>;
/** A link that is to be set: what a direction leaves out is as usual, a direction left out stays as it is. */
export interface LinkChange {
  up_delay_s: number;
  down_delay_s: number;
  up?: Partial<DirectionModel> | null;
  down?: Partial<DirectionModel> | null;
}
export type LinkCounters = Wire<"LinkCounters">;
export type Outage = Wire<"Outage">;
export type CarrierReport = Wire<"CarrierReport">;
export type LinkReport = Wire<"LinkReport">;

export type TerrainNotice = Wire<"TerrainNotice">;
export type TerrainVersion = Wire<"TerrainVersion">;
export type TerrainVersions = Wire<"TerrainVersions">;
export type DrapeShape = Wire<"DrapeShape">;
export type TextureAnswer = Wire<"TextureAnswer">;
export type OverlayAnswer = Wire<"OverlayAnswer">;
export type OverlayList = Wire<"OverlayList">;
export type TerrainFiles = Wire<"TerrainFiles">;
export type ImportRequest = Wire<"ImportRequest">;
export type CellAnswer = Omit<Wire<"CellAnswer">, "position_m"> & { position_m: Vec2 };

export type CamerasAnswer = Wire<"CamerasAnswer">;
export type CameraAnswer = Wire<"CameraAnswer">;
export type CoverageAnswer = Wire<"CoverageAnswer">;
export type HiddenGround = Omit<Wire<"HiddenGround">, "place_m"> & { place_m: Vec2 };
export type ReconstructionRequest = Wire<"ReconstructionRequest">;
export type ReconstructionAnswer = Wire<"ReconstructionAnswer">;
export type VersionPair = Wire<"VersionPair">;
export type VersionChanges = Wire<"VersionChanges">;
export type PairProgress = Wire<"PairProgress">;
export type PairStage = Wire<"PairStage">;

export type JobReport = Wire<"JobReport">;
export type ErrorInfo = Omit<Wire<"ErrorInfo">, "details"> & { details?: unknown };
export type EventLevel = Wire<"EventLevel">;
export type EventNotice = Wire<"EventNotice">;

export type PlanRequest = Wire<"PlanRequest">;
export type PlanAnalysis = Wire<"PlanAnswer">;
/** A plan that the server keeps, so that it has an identity. */
export type PlanAnswer = PlanAnalysis & { id: string };
export type PlanStatistics = Wire<"PlanStatistics">;
export type PlanCommand = Wire<"PlanCommand">;
export type PlanFinding = Wire<"PlanFinding">;

export type LogInfo = Wire<"LogInfo">;
export type LogList = Wire<"LogList">;
export type ReplayState = Wire<"ReplayState">;
export type ReplayChange = Wire<"ReplayChange">;
export type ReplayMargins = Wire<"ReplayMargins">;

export type StreamRequest = Wire<"StreamRequest">;
type Told = Wire<"StreamFrame">;
/** What a message holds depends on its channel. */
export type StreamMessage = Omit<Extract<Told, { op: "message" }>, "message"> & {
  message: unknown;
};
export type StreamFrame = Exclude<Told, { op: "message" }> | StreamMessage;
