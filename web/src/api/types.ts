// The messages of the server as they are on the wire: SI units, radians, RFC 3339 times.
// Mirrors crates/wire; to be replaced by types generated from openapi.json.

export type Vec2 = [number, number];
export type Vec3 = [number, number, number];
export type Quat = [number, number, number, number];

/** Position (m) and unit quaternion `[x, y, z, w]`. */
export interface Pose {
  position_m: Vec3;
  orientation_xyzw: Quat;
}

export interface RoverState {
  base: Pose;
  joints_rad: Record<string, number[]>;
  wheels_rad?: Record<string, number>;
}

export type RoverMode = "idle" | "executing" | "stopped" | "fault";

export interface RoverTelemetry {
  state: RoverState;
  contacts: Record<string, boolean>;
  contact_points_m: Record<string, Vec3>;
  wheel_forces_n: Record<string, Vec3>;
  joint_torques_nm: Record<string, number[]>;
  mode: RoverMode;
  executing?: { command_id: string; progress: number };
  fault?: string;
}

export interface PolygonAnswer {
  polygon_m: Vec2[];
  area_m2: number;
  margin_m: number;
  critical_edge_m?: [Vec2, Vec2];
  critical?: string;
}

export interface StabilityDerived {
  com_m: Vec3;
  regular: PolygonAnswer | null;
  conservative: PolygonAnswer | null;
  conservative_kind: "area" | "point" | "empty";
  settlement_margin_m: number | null;
  settlement_leg: string | null;
  torque_ratio: number;
  torque_joint: string;
  torque_ratios: Record<string, number[]>;
}

export interface JointKnot {
  joints_rad: number[];
  time_s: number;
}

export type CommandBody =
  | { type: "joint_path"; leg: string; knots: JointKnot[] }
  | { type: "wheel_line"; leg: string; position_m: Vec3 }
  | { type: "stop" };

export type CommandState =
  | "staged"
  | "armed"
  | "sent"
  | "received"
  | "executing"
  | "done"
  | "failed"
  | "aborted"
  | "overdue"
  | "cancelled"
  | "expired";

export interface PlanCommandRef {
  plan_id: string;
  index: number;
}

export interface CommandRecord {
  id: string;
  body: CommandBody;
  title: string;
  plan?: PlanCommandRef;
  state: CommandState;
  operator: string;
  staged: string;
  armed_until?: string;
  sent?: string;
  arrives?: string;
  earliest_ack?: string;
  overdue_after?: string;
  duration_s: number;
  progress: number;
  why?: string;
}

export interface CommandEvent {
  command: CommandRecord;
  time: string;
  state: CommandState;
  who: string;
  why?: string;
}

export interface LinkConfig {
  up_delay_s: number;
  down_delay_s: number;
}

export interface LinkCounters {
  sent: number;
  delivered: number;
  dropped: number;
  in_flight: number;
}

export type EstopState = "clear" | "sent" | "confirmed" | "release_sent";

export interface LinkReport {
  config: LinkConfig;
  up: LinkCounters;
  down: LinkCounters;
  estop: EstopState;
}

export interface TerrainNotice {
  version: string;
  source: string;
  synthetic_detail: boolean;
}

export type JobState = "queued" | "running" | "done" | "failed" | "cancelled";

export interface ErrorInfo {
  code: string;
  message: string;
  details?: unknown;
}

export interface JobReport {
  id: string;
  kind: string;
  state: JobState;
  progress: number;
  doing: string;
  result?: string;
  error?: ErrorInfo;
}

export type EventLevel = "info" | "caution" | "warning" | "critical";

export interface EventNotice {
  level: EventLevel;
  text: string;
  who: string;
}

export interface Footfall {
  ground_m: Vec3;
  normal: Vec3;
  wheel: Pose;
}

export interface LegModel {
  name: string;
  joints: string[];
  limits_rad: Vec2[];
  torque_limits_nm: number[];
  wheel_link: string;
  wheel_joint: string;
  wheel_radius_m: number;
  wheel_width_m: number;
  reach_m: number;
}

export interface Payload {
  link: string;
  mass_kg: number;
  com_m: Vec3;
  shape?: { box_m: Vec3 };
}

export interface RoverModel {
  robot: string;
  model_hash: string;
  scale: number;
  legs: LegModel[];
  base_link: string;
  payloads: Payload[];
  gravity_m_s2: number;
  mass_kg: number;
  margin_m: number;
  settlement_m: number;
  joint_speed_rad_s: number;
}

export interface LatestFrame {
  onboard_time: string;
  received_time: string;
  sequence: number;
  frame: RoverTelemetry;
}

export interface RoverAnswer {
  model: RoverModel;
  latest: LatestFrame | null;
  stability: StabilityDerived | null;
  terrain_version: string;
  link: LinkReport;
  now: string;
  simulated: boolean;
  log_id: string;
}

export interface TerrainVersion {
  version: string;
  source: string;
  synthetic_detail: boolean;
  created: string;
  origin_m: Vec2;
  resolution_m: number;
  size: Vec2;
  z_range_m: Vec2;
  known_share: number;
  frame_offset_m: Vec3;
  tiles: Vec2;
  layers: string[];
}

export interface TerrainVersions {
  current: string;
  versions: TerrainVersion[];
}

export interface TerrainFiles {
  files: { name: string; size: number }[];
}

export interface ImportRequest {
  file?: string;
  recipe?: { name: string; width_m?: number; resolution_m?: number };
  seed?: number;
  crop?: { center_m?: Vec2; width_m: number };
  detail_resolution_m?: number;
  place_m?: Vec2;
  heading_rad?: number;
}

export interface StageRequest {
  id?: string;
  plan?: PlanCommandRef;
  body?: CommandBody;
  dry_run?: boolean;
}

export interface CommandList {
  commands: CommandRecord[];
}

export interface EstopAnswer {
  state: EstopState;
  takes_effect: string;
  token?: string;
}

export interface LogInfo {
  id: string;
  size: number;
  start: string | null;
  end: string | null;
  messages: number;
  open: boolean;
}

export interface LogList {
  logs: LogInfo[];
}

export interface ReplayState {
  id: string;
  log: string;
  start: string;
  end: string;
  at: string;
  rate: number;
  paused: boolean;
  ended: boolean;
}

export interface ReplayChange {
  at?: string;
  rate?: number;
  paused?: boolean;
}

export interface CellAnswer {
  position_m: Vec2;
  height_m: number | null;
  normal: Vec3 | null;
  slope_rad: number | null;
  roughness_m: number | null;
  step_m: number | null;
  goodness: number | null;
  certainty: number | null;
  class: number;
}

export type Phase = "shift" | "lift" | "transit" | "drop";

export interface PlanWaypoint {
  joints_rad: number[];
  phase: Phase;
  time_s: number;
}

export interface PlanCommand {
  title: string;
  phase: Phase;
  body: CommandBody;
  duration_s: number;
}

export interface PlanFinding {
  check: string;
  ok: boolean;
  margin: number | null;
  where?: string | null;
  detail?: string | null;
}

export interface PlanAnswer {
  id: string;
  outcome: string;
  reason: string | null;
  leg: string;
  target_m: Vec3 | null;
  waypoints: PlanWaypoint[];
  commands: PlanCommand[];
  findings: PlanFinding[];
  statistics: {
    search_ms: number;
    smoothing_ms: number;
    check_ms: number;
    configurations_checked: number;
    length_rad: number;
    straight_rad: number;
  };
  basis: {
    state_hash: string;
    terrain_version: string;
    model_hash: string;
    seed: number;
    version: string;
  };
  footfall: Footfall | null;
  margins: { time_s: number; margin_m: number }[];
}

export interface PlanRequest {
  leg: string;
  target: { position_m: Vec3 };
  seed?: number;
  lift_m?: number;
}

/** What a listener sends on the stream. */
export type StreamRequest =
  | { op: "subscribe"; channels?: string[]; replay?: string }
  | { op: "unsubscribe"; replay?: string }
  | { op: "ping"; nonce: number };

export interface StreamMessage {
  op: "message";
  replay?: string;
  channel: string;
  sequence: number;
  onboard_time: string;
  sent_time: string;
  received_time: string;
  message: unknown;
}

/** What the server sends on the stream. */
export type StreamFrame =
  | { op: "hello"; now: string; connection: string }
  | StreamMessage
  | { op: "gap"; replay?: string; missed: number }
  | { op: "replay"; state: ReplayState }
  | { op: "pong"; nonce: number; now: string }
  | { op: "error"; error: ErrorInfo };
