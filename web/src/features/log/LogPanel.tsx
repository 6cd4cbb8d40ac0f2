// What happened: commands and events, newest first.

import { readable } from "../../lib/format";
import { formatClock, parseOptional } from "../../lib/time";
import type { EventLevel } from "../../api/types";
import type { Status } from "../../store/causes";
import { useChannels } from "../../store/console";
import { StatusMark } from "../../ui/StatusMark";
import { CommandMark } from "../commands/CommandMark";
import { COMMAND_WORDS } from "../../lib/commandClock";

const LEVELS: Record<EventLevel, Status> = {
  info: "off",
  caution: "caution",
  warning: "serious",
  critical: "critical",
};

export function LogPanel() {
  const commands = useChannels((c) => c.commands);
  const events = useChannels((c) => c.events);
  return (
    <>
      <section className="section stack" aria-label="Commands so far">
        <h2>Commands</h2>
        {commands.length === 0 && <p className="quiet">None in this session.</p>}
        <ul className="commands" data-testid="command-log">
          {[...commands].reverse().map((command) => (
            <li key={command.id} className="command" data-state={command.state}>
              <CommandMark state={command.state} />
              <div className="command-text">
                <span>{readable(command.title)}</span>
                <span className="quiet small">
                  {COMMAND_WORDS[command.state]} by {command.operator}
                </span>
                {command.why && <span className="trouble small">{readable(command.why)}</span>}
              </div>
              <span className="num quiet">
                {formatClock(parseOptional(command.sent ?? command.staged) ?? NaN)}
              </span>
            </li>
          ))}
        </ul>
      </section>
      <section className="section stack" aria-label="Events">
        <h2>Events</h2>
        {events.length === 0 && <p className="quiet">Nothing has happened yet.</p>}
        <ul className="commands" data-testid="event-log">
          {events.slice(0, 60).map((event) => (
            <li key={event.sequence} className="command">
              <StatusMark status={LEVELS[event.message.level]} label={event.message.level} />
              <div className="command-text">
                <span>{readable(event.message.text)}</span>
                <span className="quiet small">{event.message.who}</span>
              </div>
              <span className="num quiet">{formatClock(event.received_ms)}</span>
            </li>
          ))}
        </ul>
      </section>
    </>
  );
}
