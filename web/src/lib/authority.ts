// Who may command, as one console sees it.

import type { AuthorityReport } from "../api/types";
import { formatSpan, parseOptional } from "./time";

export type Holder = "nobody" | "mine" | "theirs";

export interface AuthorityView {
  holder: Holder;
  /** Name of who has it; null where nobody has. */
  name: string | null;
  /** Seconds until it lapses, unless its holder is heard; null where nobody has it. */
  left_s: number | null;
  /** Share of the lease that is left, 0 to 1. */
  left: number;
  /** Who asks for it, and for how much longer (s). */
  asked: { by: string; left_s: number } | null;
  explicit: boolean;
  lease_s: number;
}

const LEASE_USUAL_S = 30;

export function authorityView(
  report: AuthorityReport | undefined,
  operator: string,
  now_ms: number,
): AuthorityView {
  const until = parseOptional(report?.until);
  const alive = report?.holder != null && (until === null || until > now_ms);
  const name = alive ? report.holder! : null;
  const lease_s = report?.lease_s || LEASE_USUAL_S;
  const left_s = name === null || until === null ? null : (until - now_ms) / 1000;
  const askedUntil = parseOptional(report?.asked_until);
  const asks = alive && report.asked_by != null && askedUntil !== null && askedUntil > now_ms;
  return {
    holder: name === null ? "nobody" : name === operator ? "mine" : "theirs",
    name,
    left_s,
    left: left_s === null ? 0 : Math.min(1, Math.max(0, left_s / lease_s)),
    asked: asks ? { by: report.asked_by!, left_s: (askedUntil - now_ms) / 1000 } : null,
    explicit: report?.explicit ?? false,
    lease_s,
  };
}

/** Why commands cannot be armed or sent from here, or null. */
export function withoutAuthority(view: AuthorityView): string | null {
  if (view.holder === "theirs") {
    return `${view.name} has the authority to command. Ask for it in the bar on top.`;
  }
  if (view.holder === "nobody" && view.explicit) {
    return "Nobody has the authority to command. Take it in the bar on top.";
  }
  return null;
}

/** What will become of it when nothing more is done. */
export function leaseSentence(view: AuthorityView): string {
  const lease = formatSpan(view.lease_s);
  switch (view.holder) {
    case "nobody":
      return view.explicit
        ? "Nothing can be armed until somebody takes it."
        : "Arming a command takes it, too.";
    case "mine":
      return `This console renews it while it is open. Closed, it lapses after ${lease}.`;
    case "theirs":
      return `It lapses ${lease} after the last word of ${view.name}'s console.`;
  }
}

/** How often its holder renews it (ms): three times in a lease. */
export function renewEvery_ms(lease_s: number): number {
  return Math.max(300, (lease_s * 1000) / 3);
}
