// The authority to command: asked for, taken, handed over, given up; and renewed while this console has it.

import { useMemo } from "react";
import { create } from "zustand";

import { api, sentenceOf } from "../api/client";
import type { AuthorityReport } from "../api/types";
import { type AuthorityView, authorityView, renewEvery_ms } from "../lib/authority";
import { serverNow } from "./clock";
import { noteAuthority, useConsole, useLive } from "./console";
import { useServerNow } from "./now";
import { useView } from "./view";

interface AuthorityRequests {
  busy: boolean;
  failure: string | null;
  /** A request that this console does not answer now. */
  dismissed: string | null;
}

export const useAuthorityRequests = create<AuthorityRequests>(() => ({
  busy: false,
  failure: null,
  dismissed: null,
}));

async function ask(work: () => Promise<AuthorityReport>): Promise<boolean> {
  if (useAuthorityRequests.getState().busy) return false;
  useAuthorityRequests.setState({ busy: true, failure: null });
  try {
    noteAuthority(await work());
    return true;
  } catch (error) {
    useAuthorityRequests.setState({ failure: sentenceOf(error) });
    return false;
  } finally {
    useAuthorityRequests.setState({ busy: false });
  }
}

export const takeAuthority = () => ask(() => api.acquireAuthority(false));
export const takeOverAuthority = () => ask(() => api.acquireAuthority(true));
export const askForAuthority = () => ask(() => api.requestAuthority());
export const handOverAuthority = (to: string) => ask(() => api.handOverAuthority(to));
export const giveUpAuthority = () => ask(() => api.releaseAuthority());

export function useAuthority(): AuthorityView {
  const report = useLive((c) => c.link?.message.authority);
  const operator = useView((s) => s.operator);
  const now = useServerNow();
  return useMemo(() => authorityView(report, operator, now), [report, operator, now]);
}

/** Keeps what this console has: its holder's word, three times in a lease. Called once. */
export function startAuthority(): () => void {
  let last_ms = 0;
  const timer = window.setInterval(() => {
    const { connection, stream } = useConsole.getState();
    if (connection !== "open") return;
    const report = stream.live.link?.message.authority;
    const view = authorityView(report, useView.getState().operator, serverNow());
    if (view.holder !== "mine" || Date.now() - last_ms < renewEvery_ms(view.lease_s)) return;
    last_ms = Date.now();
    // Whoever has taken it over meanwhile is told of by the stream.
    api.renewAuthority().then(noteAuthority, () => {});
  }, 500);
  return () => clearInterval(timer);
}
