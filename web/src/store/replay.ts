// Looking at a flight log instead of the live rover.

import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { LogInfo, ReplayChange } from "../api/types";
import { enterReplay, leaveReplay, noteReplay, useConsole } from "./console";
import { dropPlan } from "./plan";

interface LogsState {
  logs: LogInfo[] | null;
  busy: boolean;
  failure: string | null;
}

export const useLogs = create<LogsState>(() => ({ logs: null, busy: false, failure: null }));

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

export const openLog = (log: string) =>
  guarded(async () => {
    const before = useConsole.getState().stream.replayState;
    const replay = await api.startReplay(log, 1);
    dropPlan();
    if (before) {
      leaveReplay();
      api.endReplay(before.id).catch(() => {});
    }
    enterReplay(replay);
  });

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
