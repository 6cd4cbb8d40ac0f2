// The fold of the stream's frames: live and replayed messages are kept apart, gaps are counted.

import type {
  CommandEvent,
  CommandRecord,
  CommandState,
  ErrorInfo,
  EventNotice,
  JobReport,
  LinkReport,
  ReplayState,
  RoverTelemetry,
  StabilityDerived,
  StreamFrame,
  StreamMessage,
  TerrainNotice,
} from "../api/types";
import { parseTime } from "../lib/time";

/** A message with its times (ms since 1970). */
export interface Stamped<T> {
  message: T;
  sequence: number;
  onboard_ms: number;
  received_ms: number;
}

/** Latest of every channel of one source. */
export interface Channels {
  rover: Stamped<RoverTelemetry> | null;
  stability: Stamped<StabilityDerived> | null;
  link: Stamped<LinkReport> | null;
  terrain: Stamped<TerrainNotice> | null;
  /** In order of staging. */
  commands: CommandRecord[];
  /** When the last word on each command came (ms). */
  heard_ms: Record<string, number>;
  /** Newest first, bounded. */
  events: Stamped<EventNotice>[];
  /** Messages that this console was too slow for. */
  missed: number;
}

export const NO_CHANNELS: Channels = {
  rover: null,
  stability: null,
  link: null,
  terrain: null,
  commands: [],
  heard_ms: {},
  events: [],
  missed: 0,
};

export interface StreamState {
  live: Channels;
  /** Channels of the replay that is open; null when looking at the live rover. */
  replay: Channels | null;
  replayState: ReplayState | null;
  jobs: Record<string, JobReport>;
  error: ErrorInfo | null;
}

export const NO_STREAM: StreamState = {
  live: NO_CHANNELS,
  replay: null,
  replayState: null,
  jobs: {},
  error: null,
};

const MAX_EVENTS = 200;
const MAX_JOBS = 50;

export function reduce(state: StreamState, frame: StreamFrame): StreamState {
  switch (frame.op) {
    case "message":
      return message(state, frame);
    case "gap": {
      const count = (c: Channels): Channels => ({ ...c, missed: c.missed + frame.missed });
      if (frame.replay == null) return { ...state, live: count(state.live) };
      return ofThisReplay(state, frame.replay) && state.replay
        ? { ...state, replay: count(state.replay) }
        : state;
    }
    case "replay":
      return replayed(state, frame.state);
    case "error":
      return { ...state, error: frame.error };
    default:
      return state;
  }
}

export function openReplay(state: StreamState, replay: ReplayState): StreamState {
  return { ...state, replay: NO_CHANNELS, replayState: replay };
}

export function closeReplay(state: StreamState): StreamState {
  return { ...state, replay: null, replayState: null };
}

function ofThisReplay(state: StreamState, id: string): boolean {
  return state.replayState?.id === id;
}

function replayed(state: StreamState, next: ReplayState): StreamState {
  if (!ofThisReplay(state, next.id)) return state;
  const back = parseTime(next.at) < parseTime(state.replayState?.at ?? next.at) - 500;
  const replay = back && state.replay ? upTo(state.replay, parseTime(next.at)) : state.replay;
  return { ...state, replay, replayState: next };
}

/** Going back in time un-happens what came later; the server tells again what was true before. */
function upTo(channels: Channels, at_ms: number): Channels {
  const known = <T>(told: Stamped<T> | null) => (told && told.received_ms <= at_ms ? told : null);
  return {
    ...channels,
    rover: known(channels.rover),
    stability: known(channels.stability),
    commands: channels.commands.filter((c) => (channels.heard_ms[c.id] ?? 0) <= at_ms),
    events: channels.events.filter((e) => e.received_ms <= at_ms),
  };
}

function message(state: StreamState, frame: StreamMessage): StreamState {
  if (frame.channel === "job/progress") {
    return { ...state, jobs: withJob(state.jobs, frame.message as JobReport) };
  }
  if (frame.replay == null) return { ...state, live: fold(state.live, frame) };
  if (!ofThisReplay(state, frame.replay) || !state.replay) return state;
  return { ...state, replay: fold(state.replay, frame) };
}

function fold(channels: Channels, frame: StreamMessage): Channels {
  const stamped = <T>(): Stamped<T> => ({
    message: frame.message as T,
    sequence: frame.sequence,
    onboard_ms: parseTime(frame.onboard_time),
    received_ms: parseTime(frame.received_time),
  });
  switch (frame.channel) {
    case "rover/state":
      return { ...channels, rover: stamped() };
    case "rover/stability":
      return { ...channels, stability: stamped() };
    case "link/report":
      return { ...channels, link: stamped() };
    case "terrain/version":
      return { ...channels, terrain: stamped() };
    case "command/event": {
      const event = frame.message as CommandEvent;
      const record: CommandRecord = { ...event.command, state: event.state };
      const heard_ms = { ...channels.heard_ms, [record.id]: parseTime(frame.received_time) };
      return { ...channels, heard_ms, commands: withCommand(channels.commands, record) };
    }
    case "event": {
      const known = channels.events.some((e) => e.sequence === frame.sequence);
      if (known) return channels;
      return {
        ...channels,
        events: [stamped<EventNotice>(), ...channels.events].slice(0, MAX_EVENTS),
      };
    }
    default:
      return channels;
  }
}

const ORDER: CommandState[] = ["staged", "armed", "sent", "received", "executing", "overdue"];

/** Does a command come to `a` after `b`? What is over comes after everything. */
export function isLater(a: CommandState, b: CommandState): boolean {
  const rank = (state: CommandState) =>
    ORDER.includes(state) ? ORDER.indexOf(state) : ORDER.length;
  return rank(a) > rank(b);
}

/** Puts a record in place of its older self, or at the end. */
export function withCommand(commands: CommandRecord[], record: CommandRecord): CommandRecord[] {
  const at = commands.findIndex((c) => c.id === record.id);
  return at < 0 ? [...commands, record] : commands.with(at, record);
}

export function withJob(
  jobs: Record<string, JobReport>,
  job: JobReport,
): Record<string, JobReport> {
  const next = { ...jobs, [job.id]: job };
  const ids = Object.keys(next);
  for (const id of ids.slice(0, Math.max(0, ids.length - MAX_JOBS))) delete next[id];
  return next;
}

/** What the screen shows: the replay while one is open, else the live rover. */
export function shown(state: StreamState): Channels {
  return state.replay ?? state.live;
}
