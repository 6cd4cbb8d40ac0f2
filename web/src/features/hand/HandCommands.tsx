// Commands by hand that are open or under way, with arm and take back.

import { commandClock, isOpen, isUnderWay } from "../../lib/commandClock";
import { readable } from "../../lib/format";
import { arm, takeBack, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { useBlocked } from "../../store/permission";
import { CommandMark } from "../commands/CommandMark";
import { VerificationLine } from "../commands/Verification";

export function HandCommands() {
  const commands = useLive((c) => c.commands);
  const blocked = useBlocked();
  const { busy, failures } = useRequests();
  const now = useServerNow();
  const shown = commands.filter((c) => !c.plan && (isOpen(c.state) || isUnderWay(c.state)));
  if (shown.length === 0) return null;
  return (
    <section className="section" aria-label="Commands by hand">
      <ol className="commands">
        {shown.map((command) => {
          const clock = commandClock(command, now);
          const armable = command.state === "staged" || clock.armed_s === 0;
          return (
            <li key={command.id} className="command" data-state={command.state}>
              <CommandMark state={command.state} />
              <div className="command-text">
                <span>{readable(command.title)}</span>
                <span className="quiet small">
                  {clock.word} {clock.waits}
                </span>
                <VerificationLine command={command} />
                {failures[command.id] && (
                  <span className="trouble small">{failures[command.id]}</span>
                )}
              </div>
              {armable && (
                <span className="row command-actions">
                  <button
                    type="button"
                    className="button bare"
                    data-testid="hand-cancel"
                    onClick={() => void takeBack(command.id)}
                  >
                    Cancel
                  </button>
                  <button
                    type="button"
                    className="button primary"
                    data-testid="hand-arm"
                    disabled={blocked !== null || busy[command.id]}
                    title={blocked ?? "Arm for 30 s; sending is done from the strip below"}
                    onClick={() => void arm(command.id)}
                  >
                    Arm
                  </button>
                </span>
              )}
            </li>
          );
        })}
      </ol>
    </section>
  );
}
