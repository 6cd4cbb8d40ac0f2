// Puts commands in order, planned ones and those by hand, and stages them as one. It exists in this console only
// until it is staged whole; the rover ends it at the first step that fails.

import { ListChecks, ListPlus } from "lucide-react";

import { useBlocked } from "../../store/permission";
import {
  clearSequence,
  dryRunSequence,
  setPreconditions,
  stageSequence,
  useSequence,
} from "../../store/sequence";
import { useConsole } from "../../store/console";
import { Conditions } from "../conditions/Conditions";
import { DryRunReport } from "./DryRunReport";
import { StepRow } from "./StepRow";
import "./sequence.css";

export function SequenceBuilder() {
  const { steps, preconditions, dryRun, busy, failure } = useSequence();
  const map = useConsole((s) => s.liveTerrain);
  const blocked = useBlocked();
  const stale = steps.some((s) => s.plannedOn !== null && map !== null && s.plannedOn !== map);
  if (steps.length === 0) {
    return (
      <section className="section stack" aria-label="Sequence" data-testid="sequence">
        <h2>Sequence</h2>
        <p className="quiet sequence-empty">
          Empty. Press <ListPlus size={14} aria-label="the list mark" /> beside any command by hand,
          or “Into a sequence” below a plan.
        </p>
        <p className="quiet small">
          The rover carries the steps out one after another; the first that fails ends it, and those
          after it are not begun.
        </p>
        {failure && <p className="trouble small">{failure}</p>}
      </section>
    );
  }
  const why = blocked ?? (stale ? "A planned step was checked on another map: plan it anew" : null);
  return (
    <section className="section stack" aria-label="Sequence" data-testid="sequence">
      <div className="row between">
        <h2>
          Sequence of {steps.length} {steps.length === 1 ? "step" : "steps"}
        </h2>
        <button
          type="button"
          className="button bare"
          data-testid="sequence-clear"
          onClick={clearSequence}
        >
          Clear
        </button>
      </div>
      <ol className="sequence-steps">
        {steps.map((step, i) => (
          <StepRow
            key={step.key}
            step={step}
            at={i}
            n={steps.length}
            foreseen={dryRun?.steps?.[i]}
            otherMap={step.plannedOn !== null && map !== null && step.plannedOn !== map}
          />
        ))}
      </ol>
      <details className="conditions-next">
        <summary className="small quiet">
          {preconditions.length === 0
            ? "Begin only if telemetry shows…"
            : `Begins on ${preconditions.length} ${preconditions.length === 1 ? "condition" : "conditions"}`}
        </summary>
        <Conditions
          name="sequence"
          value={preconditions}
          set={(next) => setPreconditions(null, next)}
          channels={["rover/state", "rover/stability"]}
        />
      </details>
      {dryRun && <DryRunReport report={dryRun} />}
      {failure && (
        <p className="trouble small" role="alert" data-testid="sequence-failure">
          {failure}
        </p>
      )}
      <div className="row sequence-acts">
        <button
          type="button"
          className="button"
          data-testid="sequence-dry-run"
          disabled={busy}
          title="All checks but the release; nothing is staged"
          onClick={() => void dryRunSequence()}
        >
          <ListChecks size={14} aria-hidden />
          Dry run
        </button>
        <button
          type="button"
          className="button primary"
          data-testid="sequence-stage"
          disabled={busy || why !== null}
          title={why ?? "Stage the whole of it as one command"}
          onClick={() => void stageSequence()}
        >
          Stage sequence
        </button>
      </div>
    </section>
  );
}
