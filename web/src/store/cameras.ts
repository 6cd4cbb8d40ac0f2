// The stereo pairs: which are chosen, what they would see, and asking them. Of the live rover only.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type {
  CameraAnswer,
  CoverageAnswer,
  JobReport,
  ReconstructionAnswer,
  Vec2,
} from "../api/types";
import { requestOf, type Wish } from "../lib/cameras";
import { coverageRaster, type CoverageRaster } from "../lib/coverage";
import { Latest } from "../lib/latest";
import { followJob, useConsole } from "./console";
import { liveBasis } from "./reach";
import { useSelection } from "./selection";
import { showLayer } from "./mapLayer";
import { loadVersions } from "./versions";
import { useView } from "./view";

export interface CamerasState {
  /** Null until they have come. */
  cameras: CameraAnswer[] | null;
  rate_bps: number | null;
  chosen: string[];
  wish: Wish;
  coverage: CoverageAnswer | null;
  raster: CoverageRaster | null;
  /** A coverage is being computed. */
  looking: boolean;
  /** Why there are no cameras, no coverage, or no new map. */
  failure: string | null;
  asking: { names: string[]; job: JobReport | null } | null;
  answer: ReconstructionAnswer | null;
}

export const useCameras = create<CamerasState>(() => ({
  cameras: null,
  rate_bps: null,
  chosen: [],
  wish: {
    detail: "half",
    region: "all",
    resolution_m: 0.05,
    keepPrior: true,
    anew: false,
  },
  coverage: null,
  raster: null,
  looking: false,
  failure: null,
  asking: null,
  answer: null,
}));

const set = useCameras.setState;
const get = useCameras.getState;

export async function loadCameras(): Promise<void> {
  try {
    const { cameras, downlink_bps } = await api.cameras();
    set({ cameras, rate_bps: downlink_bps ?? null, failure: null });
  } catch (error) {
    set({ failure: sentenceOf(error) });
  }
}

/** The chosen pairs, in the order of the rig. */
export function chosenCameras({ cameras, chosen }: CamerasState = get()): CameraAnswer[] {
  return (cameras ?? []).filter((c) => chosen.includes(c.name));
}

export function choose(names: string[]): void {
  set({ chosen: names, failure: null });
  if (useView.getState().overlay !== "coverage" && names.length > 0) {
    useView.setState({ overlay: "coverage" });
  }
  look();
}

export function toggle(name: string): void {
  const { chosen } = get();
  choose(chosen.includes(name) ? chosen.filter((n) => n !== name) : [...chosen, name]);
}

interface Question {
  names: string[];
  key: string;
}

const latest = new Latest<Question, CoverageAnswer>({
  ask: ({ names }, signal) => api.coverage(names, signal),
  answered: ({ key }, coverage) => {
    if (key === wanted) set({ coverage, raster: coverageRaster(coverage), looking: false });
  },
  failed: ({ key }, error) => {
    if (key !== wanted) return;
    wanted = null;
    set({ failure: sentenceOf(error), looking: false });
  },
  late: () => {},
  interval_ms: 250,
  late_ms: 5000,
  pause_ms: 2000,
});

let wanted: string | null = null;

const isShown = () => {
  const { tab, rightOpen, overlay } = useView.getState();
  return overlay === "coverage" || (rightOpen && tab === "map");
};

/** Asks for the coverage where it is looked at and none is known for this stance, map and choice. */
function look(): void {
  const { chosen, asking } = get();
  const basis = liveBasis();
  if (chosen.length === 0) {
    wanted = null;
    latest.stop();
    if (get().coverage) set({ coverage: null, raster: null, looking: false });
    return;
  }
  if (basis === null || asking || !isShown()) return;
  if (useConsole.getState().connection !== "open") return;
  const key = `${chosen.join()}|${basis}`;
  if (key === wanted) return;
  wanted = key;
  set({ looking: true });
  latest.want({ names: [...chosen], key });
}

/** Keeps the coverage up to date until the returned function is called. */
export function startCameras(): () => void {
  const stops = [useConsole, useView].map((store) =>
    (store.subscribe as (listener: () => void) => () => void)(look),
  );
  return () => {
    stops.forEach((stop) => stop());
    latest.stop();
    wanted = null;
  };
}

let asked = 0;

function places(): { rover: Vec2 | null; pick: Vec2 | null } {
  const base = useConsole.getState().stream.live.rover?.message.state.base.position_m;
  const { pick } = useSelection.getState();
  return {
    rover: base ? [base[0], base[1]] : null,
    pick: pick ? [pick[0], pick[1]] : null,
  };
}

/** Asks the chosen pairs for a new version of the map. */
export async function askPairs(): Promise<void> {
  const cameras = chosenCameras();
  if (cameras.length === 0 || get().asking) return;
  const mine = ++asked;
  const current = () => mine === asked;
  const names = cameras.map((c) => c.name);
  latest.stop();
  wanted = null;
  set({ asking: { names, job: null }, answer: null, failure: null, looking: false });
  try {
    const accepted = await api.reconstruct(requestOf(cameras, get().wish, places()));
    const job = await followJob(accepted, (report) => {
      if (current()) set({ asking: { names, job: report } });
    });
    if (!current()) return;
    if (job.state === "cancelled") return set({ asking: null });
    if (job.state !== "done" || job.result == null) {
      throw new Error(job.error?.message ?? job.doing);
    }
    const answer = await api.reconstruction(job.result);
    set({ asking: null, answer, wish: { ...get().wish, anew: false } });
    showLayer("seen");
    await loadVersions();
  } catch (error) {
    if (current()) set({ asking: null, failure: sentenceOf(error) });
  } finally {
    look();
  }
}

export function cancelAsking(): void {
  const job = get().asking?.job;
  if (job) void api.cancelJob(job.id).catch(() => {});
}
