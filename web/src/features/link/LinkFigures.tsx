// What was counted of the link, what waits in its queues, and that nothing is missing.

import type { LinkCounters, LinkReport, QueueFill } from "../../api/types";
import { fileSize, words } from "../../lib/format";
import { offBalance } from "../../lib/linkModel";
import { StatusMark } from "../../ui/StatusMark";

type Row = [string, (c: LinkCounters) => number | undefined, quiet?: boolean];

const ROWS: Row[] = [
  ["sent", (c) => c.sent],
  ["copies made", (c) => c.duplicated],
  ["arrived", (c) => c.delivered],
  ["dropped", (c) => c.dropped],
  ["lost on the way", (c) => c.dropped_by?.loss, true],
  ["arrived damaged", (c) => c.dropped_by?.corruption, true],
  ["in an outage", (c) => c.dropped_by?.outage, true],
  ["waited too long", (c) => c.dropped_by?.ttl, true],
  ["no room", (c) => c.dropped_by?.overflow, true],
  ["waiting or under way", (c) => c.in_flight],
  ["of these waiting", (c) => c.queued, true],
];

export function LinkFigures({ link }: { link: LinkReport }) {
  // A cause that has dropped nothing needs no line.
  const rows = ROWS.filter(([, of, part]) => !part || of(link.up) || of(link.down));
  return (
    <>
      <section className="section stack" aria-label="Counters">
        <table className="link-table num" data-testid="link-counters">
          <thead>
            <tr>
              <th>messages</th>
              <th scope="col">up</th>
              <th scope="col">down</th>
            </tr>
          </thead>
          <tbody>
            {rows.map(([name, of, part]) => (
              <tr key={name} className={part ? "quiet" : ""}>
                <th scope="row" className={part ? "link-part" : ""}>
                  {name}
                </th>
                <td>{of(link.up) ?? "–"}</td>
                <td>{of(link.down) ?? "–"}</td>
              </tr>
            ))}
            <tr>
              <th scope="row">adds up</th>
              <td>
                <Balance counters={link.up} />
              </td>
              <td>
                <Balance counters={link.down} />
              </td>
            </tr>
          </tbody>
        </table>
      </section>
      <section className="section stack" aria-label="Queues">
        <Queues direction="up" queues={link.up_queues ?? []} />
        <Queues direction="down" queues={link.down_queues ?? []} />
      </section>
    </>
  );
}

/** Sent and copied are arrived, dropped, or under way: always. */
function Balance({ counters }: { counters: LinkCounters }) {
  const off = offBalance(counters);
  return (
    <span data-testid="balance" data-off={off}>
      {off === 0 ? (
        <StatusMark status="normal" label="yes" />
      ) : (
        <span className="trouble">off by {off}</span>
      )}
    </span>
  );
}

function Queues({ direction, queues }: { direction: "up" | "down"; queues: QueueFill[] }) {
  if (queues.length === 0) {
    return <p className="quiet small">Nothing waits to be transmitted {direction}.</p>;
  }
  return (
    <ul className="stack link-queues" data-testid={`queues-${direction}`}>
      {queues.map((queue) => {
        const share = Math.min(1, queue.bytes / Math.max(1, queue.room_bytes));
        return (
          <li key={queue.class} data-class={queue.class}>
            <span className="row between small">
              <span>
                {words(queue.class)} {direction}
              </span>
              <span className="num quiet">
                {queue.messages}, {fileSize(queue.bytes)} of {fileSize(queue.room_bytes)}
              </span>
            </span>
            <div className="bar" aria-hidden>
              {/* Whatever waits is to be seen. */}
              <span style={{ width: `max(2px, ${(100 * share).toFixed(1)}%)` }} />
            </div>
          </li>
        );
      })}
    </ul>
  );
}
