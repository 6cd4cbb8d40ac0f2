// Commands by hand that are open or under way, with arm and take back; and those that ended otherwise than done,
// until they are hidden.

import { X } from "lucide-react";

import type { CommandRecord } from "../../api/types";
import { commandClock, isOpen, isUnderWay, wayOn } from "../../lib/commandClock";
import { preconditionWords } from "../../lib/fields";
import { readable } from "../../lib/format";
import { hideCommand, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { ApprovalLine, ArmActions } from "../commands/ArmActions";
import { CommandMark } from "../commands/CommandMark";
import { VerificationLine } from "../commands/Verification";
import { SequenceProgress } from "../sequence/SequenceProgress";

/** Most ended commands that are shown. */
const ENDED_MAX = 3;

export function HandCommands() {
  const commands = useLive((c) => c.commands);
  const hidden = useRequests((s) => s.hidden);
  const byHand = commands.filter((c) => !c.plan && c.body.type !== "image" && !hidden[c.id]);
  const running = byHand.filter((c) => isOpen(c.state) || isUnderWay(c.state));
  const ended = byHand.filter(isTold).slice(-ENDED_MAX);
  const shown = byHand.filter((c) => running.includes(c) || ended.includes(c));
  const now = useServerNow();
  if (shown.length === 0) return null;
  return (
    <section className="section" aria-label="Commands by hand">
      <ol className="commands">
        {shown.map((command) => (
          <Row key={command.id} command={command} now_ms={now} />
        ))}
      </ol>
    </section>
  );
}

/** Ended so that the operator should read it: not as commanded, or a sequence with its steps. */
function isTold({ state, body }: CommandRecord): boolean {
  if (state === "done") return body.type === "sequence";
  return state === "failed" || state === "aborted" || state === "expired";
}

function Row({ command, now_ms }: { command: CommandRecord; now_ms: number }) {
  const failure = useRequests((s) => s.failures[command.id]);
  const clock = commandClock(command, now_ms);
  const armable = command.state === "staged" || clock.armed_s === 0;
  const over = !isOpen(command.state) && !isUnderWay(command.state);
  const next = wayOn(command);
  return (
    <li className="command" data-state={command.state} data-command={command.id}>
      <CommandMark state={command.state} />
      <div className="command-text">
        <span>{readable(command.title)}</span>
        <span className="quiet small">
          {clock.word} {clock.waits}
        </span>
        {command.preconditions?.map((p) => (
          <span key={preconditionWords(p)} className="quiet small">
            if {preconditionWords(p)}
          </span>
        ))}
        <ApprovalLine command={command} />
        <VerificationLine command={command} />
        {command.why && <span className="trouble small">{readable(command.why)}</span>}
        {next && <span className="quiet small">{next}</span>}
        {failure && (
          <span className="trouble small" role="alert">
            {failure}
          </span>
        )}
      </div>
      {armable && <ArmActions command={command} cancelId="hand-cancel" armId="hand-arm" />}
      {over && (
        <button
          type="button"
          className="button bare icon"
          aria-label={`Hide: ${readable(command.title)}`}
          title="Hide; the log keeps it"
          data-testid="hand-hide"
          onClick={() => hideCommand(command.id)}
        >
          <X size={14} aria-hidden />
        </button>
      )}
      {command.body.type === "sequence" && (
        <SequenceProgress command={command} steps={command.body.steps} />
      )}
    </li>
  );
}
