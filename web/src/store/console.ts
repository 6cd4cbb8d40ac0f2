// The connection to the ground server and everything it says.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import { localNow, Stream } from "../api/stream";
import type {
  AuthorityReport,
  CommandRecord,
  JobReport,
  ReplayState,
  RoverAnswer,
  RoverModel,
  StreamFrame,
} from "../api/types";
import { parseTime } from "../lib/time";
import { noteHello, notePong } from "./clock";
import {
  type Channels,
  closeReplay,
  isLater,
  NO_STREAM,
  openReplay,
  reduce,
  shown,
  type StreamState,
  withCommand,
  withJob,
} from "./streamState";

export type Connection = "connecting" | "open" | "lost";

export interface ConsoleState {
  connection: Connection;
  /** When the next attempt is made, local time (ms). */
  retryAt_ms: number;
  stream: StreamState;
  /** Local time when the replay's state was last heard (ms). */
  replayHeard_ms: number;
  model: RoverModel | null;
  urdf: string | null;
  simulated: boolean;
  logId: string | null;
  /** Map of the live rover. */
  liveTerrain: string | null;
  /** Map of what is shown. */
  terrainVersion: string | null;
  /** Why the rover's model could not be loaded. */
  failure: string | null;
}

export const useConsole = create<ConsoleState>(() => ({
  connection: "connecting",
  retryAt_ms: 0,
  stream: NO_STREAM,
  replayHeard_ms: 0,
  model: null,
  urdf: null,
  simulated: false,
  logId: null,
  liveTerrain: null,
  terrainVersion: null,
  failure: null,
}));

const set = useConsole.setState;
const get = useConsole.getState;
let stream: Stream | null = null;

/** Opens the stream; called once. */
export function start(): void {
  if (stream) return;
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  stream = new Stream(`${scheme}://${location.host}/api/v1/stream`, {
    onFrames,
    onOpen() {
      set({ connection: "open" });
      stream?.send({ op: "subscribe" });
      const replay = get().stream.replayState;
      if (replay) stream?.send({ op: "subscribe", replay: replay.id });
      void load();
    },
    onLost: (retry_ms) => set({ connection: "lost", retryAt_ms: localNow() + retry_ms }),
    onPong: (server, sent, received) => notePong(parseTime(server), sent, received),
  });
}

export function retryNow(): void {
  stream?.retryNow();
}

const LOAD_AGAIN_MS = 3000;

/** The map of the live rover, and the one to show: a replay's own where it has told it. */
function maps(of: StreamState, liveTerrain: string | null) {
  return { liveTerrain, terrainVersion: of.replay?.terrain?.message.version ?? liveTerrain };
}

/** Fetches what the stream does not bring: the model, its URDF and the commands so far. */
export async function load(): Promise<void> {
  try {
    const answer = await api.rover();
    noteHello(parseTime(answer.now));
    const known = get();
    const same = known.model?.model_hash === answer.model.model_hash && known.urdf !== null;
    const urdf = same ? known.urdf : await api.urdf(answer.model.robot);
    set((state) => ({
      model: same ? state.model : answer.model,
      urdf,
      simulated: answer.simulated,
      logId: answer.log_id,
      ...maps(state.stream, state.stream.live.terrain?.message.version ?? answer.terrain_version),
      failure: null,
      stream: { ...state.stream, live: withLatest(state.stream.live, answer) },
    }));
    const before = get().stream.live.commands;
    const { commands } = await api.commands();
    set((state) => {
      // What the stream told while the answer was on its way is newer than the answer.
      const told = state.stream.live.commands.filter((c) => !before.includes(c));
      const live = { ...state.stream.live, commands: told.reduce(withCommand, commands) };
      return { stream: { ...state.stream, live } };
    });
  } catch (error) {
    if (get().model !== null) return;
    set({ failure: sentenceOf(error) });
    setTimeout(() => get().connection === "open" && void load(), LOAD_AGAIN_MS);
  }
}

/** The answer of `GET /rover`, where the stream has not brought something newer. */
function withLatest(live: Channels, answer: RoverAnswer): Channels {
  const { latest = null, stability = null } = answer;
  const now = parseTime(answer.now);
  const times = { sequence: 0, onboard_ms: now, received_ms: now };
  return {
    ...live,
    rover:
      live.rover ??
      (latest && {
        message: latest.frame,
        sequence: latest.sequence,
        onboard_ms: parseTime(latest.onboard_time),
        received_ms: parseTime(latest.received_time),
      }),
    stability: live.stability ?? (stability && { message: stability, ...times }),
    link: live.link ?? { message: answer.link, ...times },
  };
}

function onFrames(frames: StreamFrame[]): void {
  set((state) => {
    let next = state.stream;
    let { replayHeard_ms } = state;
    for (const frame of frames) {
      if (frame.op === "hello") noteHello(parseTime(frame.now));
      next = reduce(next, frame);
      if (frame.op === "replay") replayHeard_ms = localNow();
    }
    const live = next.live.terrain?.message.version ?? state.liveTerrain;
    return { stream: next, replayHeard_ms, ...maps(next, live) };
  });
}

export function enterReplay(replay: ReplayState): void {
  set((state) => ({ stream: openReplay(state.stream, replay), replayHeard_ms: localNow() }));
  stream?.send({ op: "subscribe", replay: replay.id });
}

export function noteReplay(replay: ReplayState): void {
  set((state) => ({
    stream: reduce(state.stream, { op: "replay", state: replay }),
    replayHeard_ms: localNow(),
  }));
}

export function leaveReplay(): void {
  const id = get().stream.replayState?.id;
  if (id !== undefined) stream?.send({ op: "unsubscribe", replay: id });
  set((state) => {
    const closed = closeReplay(state.stream);
    return { stream: closed, ...maps(closed, state.liveTerrain) };
  });
}

/** Takes in the answer of a request about the authority before the stream tells of it. */
export function noteAuthority(authority: AuthorityReport): void {
  set((state) => {
    const { live } = state.stream;
    if (!live.link || (live.link.message.authority?.epoch ?? 0) > authority.epoch) return state;
    const link = { ...live.link, message: { ...live.link.message, authority } };
    return { stream: { ...state.stream, live: { ...live, link } } };
  });
}

/** Takes in the answer of a request about a command before the stream tells of it. */
export function noteCommand(record: CommandRecord): void {
  set((state) => {
    const live = state.stream.live;
    const known = live.commands.find((c) => c.id === record.id);
    // On a short link the stream can be ahead of the answer.
    if (known && isLater(known.state, record.state)) return state;
    return {
      stream: {
        ...state.stream,
        live: { ...live, commands: withCommand(live.commands, record) },
      },
    };
  });
}

/** Follows a job to its end on the stream, asking once a second in case a message was missed. */
export async function followJob(
  job: JobReport,
  onProgress: (job: JobReport) => void = () => {},
): Promise<JobReport> {
  const over = (j: JobReport) => j.state !== "queued" && j.state !== "running";
  set((s) => ({ stream: { ...s.stream, jobs: withJob(s.stream.jobs, job) } }));
  onProgress(job);
  if (over(job)) return job;
  return new Promise((resolve) => {
    const finish = (last: JobReport) => {
      unsubscribe();
      clearInterval(poll);
      resolve(last);
    };
    const look = (j: JobReport | undefined) => {
      if (!j) return;
      onProgress(j);
      if (over(j)) finish(j);
    };
    const unsubscribe = useConsole.subscribe((now, before) => {
      if (now.stream.jobs[job.id] !== before.stream.jobs[job.id]) look(now.stream.jobs[job.id]);
    });
    const poll = window.setInterval(() => {
      api.job(job.id).then(look, (error: unknown) => {
        const lost = error instanceof Error && "status" in error && error.status === 404;
        if (lost) finish({ ...job, state: "failed", doing: "the server no longer knows this job" });
      });
    }, 1000);
  });
}

export const useChannels = <T>(select: (channels: Channels) => T): T =>
  useConsole((state) => select(shown(state.stream)));

export const useLive = <T>(select: (channels: Channels) => T): T =>
  useConsole((state) => select(state.stream.live));
