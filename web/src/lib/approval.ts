// The second person's word on a command, as one console sees it.

import type { CommandRecord } from "../api/types";
import { formatSpan, parseOptional } from "./time";

export interface ApprovalView {
  state: "not_needed" | "waits" | "approved" | "lapsed";
  by: string | null;
  /** Seconds for which it still holds; null unless approved. */
  left_s: number | null;
}

export function approvalView(command: CommandRecord, now_ms: number): ApprovalView {
  const { approval } = command;
  if (!approval) return { state: "not_needed", by: null, left_s: null };
  const until = parseOptional(approval.until);
  if (until === null) return { state: "waits", by: null, left_s: null };
  const by = approval.by ?? null;
  const left_s = (until - now_ms) / 1000;
  return left_s > 0 ? { state: "approved", by, left_s } : { state: "lapsed", by, left_s: null };
}

/** Does a staged command wait for a word that this operator could give? */
export function mayApprove(command: CommandRecord, operator: string, now_ms: number): boolean {
  const { state } = approvalView(command, now_ms);
  const open = state === "waits" || state === "lapsed";
  return command.state === "staged" && open && command.operator !== operator;
}

/** Why a command cannot be armed for want of a second person's word, or null. */
export function awaitsApproval(command: CommandRecord, now_ms: number): string | null {
  const view = approvalView(command, now_ms);
  if (view.state === "waits") return "A second person must approve it in their own console.";
  if (view.state === "lapsed") {
    return `The approval of ${view.by ?? "the second person"} has lapsed: it must be approved again.`;
  }
  return null;
}

/** One line for the author: who, and for how long. */
export function approvalLine(command: CommandRecord, now_ms: number): string | null {
  const view = approvalView(command, now_ms);
  switch (view.state) {
    case "not_needed":
      return null;
    case "waits":
      return "waits for a second person";
    case "approved":
      return `approved by ${view.by}, holds ${formatSpan(view.left_s ?? 0)}`;
    case "lapsed":
      return `approval of ${view.by} has lapsed`;
  }
}
