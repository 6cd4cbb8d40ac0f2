// One step of the sequence being put together: its place, what it waits for, and what a dry run says of it.

import { ArrowDown, ArrowUp, Filter, X } from "lucide-react";
import { useState } from "react";

import type { DryRun } from "../../api/types";
import { preconditionWords } from "../../lib/fields";
import { readable } from "../../lib/format";
import { formatSpan } from "../../lib/time";
import { type DraftStep, moveStep, removeStep, setPreconditions } from "../../store/sequence";
import { StatusMark } from "../../ui/StatusMark";
import { Conditions } from "../conditions/Conditions";
import { OUTCOME_MARKS, OUTCOME_WORDS } from "./outcomes";

interface Props {
  step: DraftStep;
  at: number;
  n: number;
  foreseen: NonNullable<DryRun["steps"]>[number] | undefined;
  /** It was planned on a map that is no longer in use. */
  otherMap: boolean;
}

export function StepRow({ step, at, n, foreseen, otherMap }: Props) {
  const [open, setOpen] = useState(false);
  const title = readable(step.title);
  const waits = step.preconditions.length;
  return (
    <li className="sequence-step" data-testid={`step-${at}`} data-outcome={foreseen?.outcome}>
      <div className="sequence-row">
        <span className="num quiet">{at + 1}</span>
        <span className="sequence-title">{title}</span>
        <span className="row sequence-tools">
          <Tool label={`Earlier: ${title}`} off={at === 0} act={() => moveStep(at, at - 1)}>
            <ArrowUp size={14} aria-hidden />
          </Tool>
          <Tool label={`Later: ${title}`} off={at === n - 1} act={() => moveStep(at, at + 1)}>
            <ArrowDown size={14} aria-hidden />
          </Tool>
          <button
            type="button"
            className="button bare icon"
            aria-label={`Conditions of step ${at + 1}`}
            aria-expanded={open}
            title={waits === 0 ? "Only if telemetry shows…" : `${waits} conditions`}
            data-testid={`step-${at}-filter`}
            onClick={() => setOpen(!open)}
          >
            <Filter size={14} aria-hidden />
          </button>
          <Tool label={`Remove: ${title}`} act={() => removeStep(step.key)}>
            <X size={14} aria-hidden />
          </Tool>
        </span>
      </div>
      {!open &&
        step.preconditions.map((p) => (
          <p key={preconditionWords(p)} className="quiet small">
            if {preconditionWords(p)}
          </p>
        ))}
      {open && (
        <Conditions
          name={`step-${at}`}
          value={step.preconditions}
          set={(next) => setPreconditions(step.key, next)}
          channels={["rover/state"]}
        />
      )}
      {otherMap && <p className="trouble small">Planned on another map: plan it anew.</p>}
      {foreseen && (
        <p className="row small">
          <StatusMark status={OUTCOME_MARKS[foreseen.outcome]} />
          <span className={foreseen.outcome === "failed" ? "trouble" : "quiet"}>
            {foreseen.message ? readable(foreseen.message) : OUTCOME_WORDS[foreseen.outcome]}
            {foreseen.duration_s != null && (
              <span className="num">, {formatSpan(foreseen.duration_s)}</span>
            )}
          </span>
        </p>
      )}
    </li>
  );
}

function Tool(props: { label: string; off?: boolean; act: () => void; children: React.ReactNode }) {
  const { label, off = false, act, children } = props;
  return (
    <button
      type="button"
      className="button bare icon"
      aria-label={label}
      title={label.split(":")[0]}
      disabled={off}
      onClick={act}
    >
      {children}
    </button>
  );
}
