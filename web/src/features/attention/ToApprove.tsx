// A command of another operator that takes this one's word: what it does exactly, then the word.

import type { CommandRecord } from "../../api/types";
import { approvalView } from "../../lib/approval";
import { preconditionWords } from "../../lib/fields";
import { readable } from "../../lib/format";
import { bodyWords } from "../../lib/sequence";
import { formatSpan } from "../../lib/time";
import { approve, useRequests } from "../../store/commands";
import { useServerNow } from "../../store/now";
import { useBlocked } from "../../store/permission";
import { StatusMark } from "../../ui/StatusMark";

export function ToApprove({ command }: { command: CommandRecord }) {
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy[command.id]);
  const failure = useRequests((s) => s.failures[command.id]);
  const lapsed = approvalView(command, useServerNow()).state === "lapsed";
  return (
    <div className="section stack" data-testid="to-approve" data-command={command.id}>
      <p className="row attention-what">
        <StatusMark status="caution" />
        <span>
          <strong>{command.operator}</strong> asks for your approval
          {lapsed && <span className="quiet"> again, the last has lapsed</span>}
        </span>
      </p>
      <p>{readable(command.title)}</p>
      <details className="quiet small">
        <summary>What it does exactly</summary>
        <Content command={command} />
      </details>
      {failure && (
        <p className="trouble small" role="alert">
          {failure}
        </p>
      )}
      <div className="row between">
        <span className="quiet small">holds 10 min, for this content only</span>
        <button
          type="button"
          className="button primary"
          data-testid="approve"
          disabled={blocked !== null || busy}
          title={blocked ?? `Approve it; ${command.operator} then arms and sends it`}
          onClick={() => void approve(command)}
        >
          Approve
        </button>
      </div>
    </div>
  );
}

function Content({ command }: { command: CommandRecord }) {
  const { body } = command;
  const waits = command.preconditions ?? [];
  return (
    <>
      {body.type === "sequence" ? (
        <ol className="attention-steps">
          {body.steps.map((step, i) => (
            <li key={i}>
              {bodyWords(step.body)}
              {step.preconditions?.map((p) => (
                <span key={preconditionWords(p)}>, if {preconditionWords(p)}</span>
              ))}
            </li>
          ))}
        </ol>
      ) : (
        <pre className="num attention-body">{figures(body)}</pre>
      )}
      {waits.map((p) => (
        <p key={preconditionWords(p)}>only if {preconditionWords(p)}</p>
      ))}
      <p className="num">
        takes {formatSpan(command.duration_s)}, content {command.approval?.content_hash.slice(0, 8)}
      </p>
    </>
  );
}

const KNOTS_SHOWN = 2;

/** The figures of a command; of a long path its beginning and its end. */
function figures(body: CommandRecord["body"]): string {
  const round = (_: string, value: unknown) =>
    typeof value === "number" ? Number(value.toFixed(4)) : value;
  const shown =
    "knots" in body && body.knots.length > KNOTS_SHOWN
      ? { ...body, knots: [body.knots[0], `… ${body.knots.length - 2} more …`, body.knots.at(-1)] }
      : body;
  return JSON.stringify(shown, round, 1).replace(
    /\[\s+([^[\]{}]*?)\s+\]/g,
    (_, list: string) => `[${list.replace(/\s+/g, " ")}]`,
  );
}
