// What a dry run found: every check of staging, arming, sending and beginning, passed or not.

import type { DryRun } from "../../api/types";
import { preconditionWords, shownValue } from "../../lib/fields";
import { readable } from "../../lib/format";
import { formatSpan } from "../../lib/time";
import { StatusMark } from "../../ui/StatusMark";
import { CHECK_WORDS, OUTCOME_MARKS, OUTCOME_WORDS } from "./outcomes";

export function DryRunReport({ report }: { report: DryRun }) {
  const failed = report.checks.filter((c) => c.outcome === "failed").length;
  const waits = report.checks.filter((c) => c.outcome === "waits").length;
  const summary = report.ready
    ? "Dry run: nothing is in the way"
    : failed > 0
      ? `Dry run: ${failed} ${failed === 1 ? "check fails" : "checks fail"}`
      : `Dry run: ${waits} ${waits === 1 ? "check waits" : "checks wait"}`;
  return (
    <div className="dry-run stack" data-testid="dry-run" data-ready={report.ready}>
      <p className="row between">
        <strong role="status">{summary}</strong>
        {report.duration_s != null && (
          <span className="num quiet" title="How long it takes">
            {formatSpan(report.duration_s)}
          </span>
        )}
      </p>
      <ul className="stack">
        {report.checks.map(({ check, outcome, message }) => (
          <li
            key={check}
            className="dry-run-row"
            data-testid={`check-${check}`}
            data-outcome={outcome}
          >
            <StatusMark status={OUTCOME_MARKS[outcome]} label={outcome} />
            <span className="small">
              {CHECK_WORDS[check]}
              {message && (
                <span className={outcome === "failed" ? "trouble" : "quiet"}>
                  : {readable(message)}
                </span>
              )}
            </span>
          </li>
        ))}
      </ul>
      {(report.conditions ?? []).length > 0 && (
        <ul className="stack" aria-label="Conditions" data-testid="dry-run-conditions">
          {report.conditions!.map(({ step, wanted, found, outcome }) => (
            <li
              key={`${step ?? ""} ${preconditionWords(wanted)}`}
              className="dry-run-row"
              data-outcome={outcome}
            >
              <StatusMark status={OUTCOME_MARKS[outcome]} label={OUTCOME_WORDS[outcome]} />
              <span className="small">
                {step != null && <span className="quiet">step {step + 1}: </span>}
                {preconditionWords(wanted)}
                <span className="quiet">
                  , now {shownValue(found)}
                  {outcome === "waits" && "; asked when it begins"}
                </span>
              </span>
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}
