// The steps of a sequence that was staged: how far each has come, and which were skipped and why.

import type { CommandBody, CommandRecord } from "../../api/types";
import { preconditionWords } from "../../lib/fields";
import { percent, readable } from "../../lib/format";
import { bodyWords, type StepState, stepsOf } from "../../lib/sequence";
import type { Status } from "../../store/causes";
import { StatusMark } from "../../ui/StatusMark";
import "./sequence.css";

type Steps = Extract<CommandBody, { type: "sequence" }>["steps"];

const MARKS: Record<StepState, Status> = {
  waits: "off",
  executing: "standby",
  done: "normal",
  failed: "critical",
  skipped: "off",
  unknown: "serious",
};

export function SequenceProgress({ command, steps }: { command: CommandRecord; steps: Steps }) {
  const told = stepsOf(command, steps.length);
  return (
    <ol className="sequence-told" aria-label="Steps" data-testid="sequence-progress">
      {steps.map((step, i) => {
        const { state, why, share } = told[i]!;
        return (
          <li key={i} data-state={state} className={state === "skipped" ? "quiet" : ""}>
            <StatusMark status={MARKS[state]} label={state} />
            <span className="num quiet">{i + 1}</span>
            <span className="small">
              {bodyWords(step.body)}
              {step.preconditions?.map((p) => (
                <span key={preconditionWords(p)} className="quiet">
                  , if {preconditionWords(p)}
                </span>
              ))}
              {why && (
                <span className={state === "failed" ? "trouble" : "quiet"}>
                  {" "}
                  {state === "skipped" ? "skipped: " : ""}
                  {readable(why)}
                </span>
              )}
            </span>
            <span className="small quiet num">{share === null ? "" : percent(share)}</span>
          </li>
        );
      })}
    </ol>
  );
}
