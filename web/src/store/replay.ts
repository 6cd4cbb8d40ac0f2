// Looking at a flight log instead of the live rover.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { JobReport, LogInfo, ReplayChange } from "../api/types";
import { enterReplay, followJob, leaveReplay, noteReplay, useConsole } from "./console";
import { dropPlan } from "./plan";

interface LogsState {
  logs: LogInfo[] | null;
  busy: boolean;
  failure: string | null;
  /** The log that is being opened, with the server's job once there is one. */
  opening: { log: string; job: JobReport | null } | null;
}

export const useLogs = create<LogsState>(() => ({
  logs: null,
  busy: false,
  failure: null,
  opening: null,
}));

async function guarded(work: () => Promise<void>): Promise<void> {
  useLogs.setState({ busy: true, failure: null });
  try {
    await work();
  } catch (error) {
    useLogs.setState({ failure: sentenceOf(error) });
  } finally {
    useLogs.setState({ busy: false });
  }
}

export const loadLogs = () =>
  guarded(async () => useLogs.setState({ logs: (await api.logs()).logs }));

let asked = 0;

/** Opens a log. It is read whole, which takes a while where it is long: until then all stays as it is. */
export const openLog = (log: string) =>
  guarded(async () => {
    const mine = ++asked;
    const current = () => mine === asked;
    useLogs.setState({ opening: { log, job: null } });
    try {
      const accepted = await api.startReplay(log, 1);
      const job = await followJob(accepted, (report) => {
        if (current()) useLogs.setState({ opening: { log, job: report } });
        // Taken back while the answer was on its way.
        else if (report === accepted) api.cancelJob(report.id).catch(() => {});
      });
      if (job.state === "failed") throw new Error(job.error?.message ?? job.doing);
      if (job.state !== "done" || job.result == null) return;
      const replay = await api.replayResult(job.result);
      if (!current()) {
        await api.endReplay(replay.id);
        return;
      }
      const before = useConsole.getState().stream.replayState;
      dropPlan();
      if (before) {
        leaveReplay();
        api.endReplay(before.id).catch(() => {});
      }
      enterReplay(replay);
    } finally {
      if (current()) useLogs.setState({ opening: null });
    }
  });

export function cancelOpening(): void {
  const job = useLogs.getState().opening?.job;
  asked += 1;
  useLogs.setState({ opening: null });
  // Where it does not arrive, the replay is ended when it is there.
  if (job) api.cancelJob(job.id).catch(() => {});
}

export const changeReplay = (change: ReplayChange) =>
  guarded(async () => {
    const id = useConsole.getState().stream.replayState?.id;
    if (id === undefined) return;
    const answer = await api.changeReplay(id, change);
    if (answer) noteReplay(answer);
  });

/** Back to live, whether or not the server answers. */
export const backToLive = async () => {
  const id = useConsole.getState().stream.replayState?.id;
  leaveReplay();
  if (id !== undefined) await api.endReplay(id).catch(() => {});
};
