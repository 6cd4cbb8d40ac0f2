// How far a sent command is verified: one mark a stage, and what is due next.

import type { CommandRecord } from "../../api/types";
import { formatSpan, parseOptional } from "../../lib/time";
import type { Status } from "../../store/causes";
import { useServerNow } from "../../store/now";
import { StatusMark } from "../../ui/StatusMark";
import "./commands.css";

type Stage = NonNullable<CommandRecord["verification"]>[number];

const MARKS: Record<Stage["outcome"], Status> = {
  pending: "off",
  ok: "normal",
  failed: "critical",
  timeout: "serious",
  unknown: "serious",
  not_reached: "off",
};

const WORDS: Record<Stage["outcome"], string> = {
  pending: "waits",
  ok: "passed",
  failed: "failed",
  timeout: "no word in time",
  unknown: "unknown",
  not_reached: "not reached",
};

/** When a word on the first open stage is due at the latest, light times considered. */
function dueIn(stages: readonly Stage[], now_ms: number): string | null {
  const open = stages.find((s) => s.outcome === "pending");
  const due = open && parseOptional(open.due);
  if (!open || due === null || due === undefined) return null;
  const left_s = (due - now_ms) / 1000;
  return left_s > 0 ? `${open.stage} due in ${formatSpan(left_s)}` : `${open.stage} is overdue`;
}

export function VerificationLine({ command }: { command: CommandRecord }) {
  const now = useServerNow();
  const stages = command.verification ?? [];
  if (stages.length === 0) return null;
  const due = dueIn(stages, now);
  return (
    <div className="verification" data-testid="verification">
      <ol aria-label="Verification">
        {stages.map((s) => (
          <li key={s.stage} data-outcome={s.outcome} title={`${s.stage}: ${WORDS[s.outcome]}`}>
            <StatusMark status={MARKS[s.outcome]} label={`${s.stage} ${WORDS[s.outcome]}`} />
            <span className="quiet small">{s.stage}</span>
          </li>
        ))}
      </ol>
      {due && <span className="quiet small num">{due}</span>}
    </div>
  );
}
