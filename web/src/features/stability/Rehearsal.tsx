// If a leg fails, or the ground settles under it, now: what is left, and whether there is a way back.

import { useEffect } from "react";

import type { PostureAccidents, PostureAftermath } from "../../api/types";
import { capital, legLabel, metres } from "../../lib/format";
import { aftermathCell, barrierWords, waysBack } from "../../lib/posture";
import { useChannels, useConsole } from "../../store/console";
import { lookAt } from "../../store/posture";
import { shownBasis } from "../../store/reach";
import { useBlocked } from "../../store/permission";
import { askRehearsal, cancelRehearsal, takeWayBack, useRehearsal } from "../../store/rehearsal";
import { JobRow } from "../../ui/JobRow";
import { StatusMark } from "../../ui/StatusMark";

/** The stance must be still for this long before it is rehearsed anew (ms). */
const STILL_MS = 1500;

export function Rehearsal() {
  const { asking, rehearsal, basis, failure } = useRehearsal();
  const now = useConsole(shownBasis);
  const idle = useChannels((c) => c.rover?.message.mode !== "executing");
  const old = rehearsal !== null && basis !== now;
  const busy = asking !== null;
  useEffect(() => {
    if (!old || busy || !idle) return;
    const timer = setTimeout(() => void askRehearsal(), STILL_MS);
    return () => clearTimeout(timer);
  }, [old, busy, idle, now]);
  // A ghost must not outlive the table that it belongs to.
  useEffect(() => () => lookAt("", null), []);
  return (
    <section className="section stack rehearsal" aria-label="Rehearsal">
      <div className="row between">
        <h2>If a leg fails now</h2>
        {!busy && (
          <button
            type="button"
            className="button bare rehearse"
            data-testid="rehearse"
            title="What is left if a leg fails or a foot settles, and the way back"
            onClick={() => void askRehearsal()}
          >
            {rehearsal ? "Again" : "Rehearse"}
          </button>
        )}
      </div>
      {rehearsal && (
        <table
          className={old ? "rehearsal-table old" : "rehearsal-table"}
          data-testid="rehearsal"
          data-state={old ? "old" : "ready"}
        >
          <thead>
            <tr>
              <th />
              <th scope="col" title="The leg bears nothing any more">
                it is lost
              </th>
              <th scope="col" title="The ground settles under its foot">
                settles {metres(rehearsal.settlement_m)}
              </th>
            </tr>
          </thead>
          <tbody>
            {rehearsal.legs.map((leg) => (
              <Row key={leg.leg} accidents={leg} />
            ))}
          </tbody>
        </table>
      )}
      {rehearsal && !busy && (
        <p className="quiet small">
          {old
            ? "For the stance before; rehearsed anew when the rover is still."
            : "Margin left. Point at a mark for what follows."}
        </p>
      )}
      {rehearsal && !busy && <WaysBack old={old} />}
      {!rehearsal && !busy && !failure && (
        <p className="quiet small">
          Not rehearsed yet: the margin that is left without each leg, and the way back.
        </p>
      )}
      {asking && (
        <JobRow
          job={asking.job}
          waiting="Rehearsing each leg"
          cancel={cancelRehearsal}
          testId="rehearsing"
        />
      )}
      {failure && (
        <p className="row" role="alert">
          <StatusMark status="serious" label="failed" />
          {failure}
        </p>
      )}
    </section>
  );
}

/** Ways back to a safe stance, each a plan at one click; the pointer shows where it ends. */
function WaysBack({ old }: { old: boolean }) {
  const { rehearsal, id, taking } = useRehearsal();
  const blocked = useBlocked();
  const ways = waysBack(rehearsal?.legs ?? []);
  if (ways.length === 0) return null;
  const why =
    blocked ??
    (id === null ? "Of a replay: to look at, not to take up" : null) ??
    (old ? "The stance has changed since: rehearse again" : null);
  return (
    <ul className="ways-back" aria-label="Ways back">
      {ways.map(({ accident, end, says }) => (
        <li
          key={`${accident.leg} ${accident.kind}`}
          className="row between"
          onPointerEnter={() => lookAt(accident.leg, end)}
          onPointerLeave={() => lookAt("", null)}
        >
          <span className="small">{says}</span>
          <button
            type="button"
            className="button"
            data-testid={`way-back-${accident.leg}-${accident.kind}`}
            disabled={why !== null || taking !== null}
            title={
              why ?? "Make the way back the plan: it is then staged, armed and sent like any other"
            }
            onClick={() => void takeWayBack(accident)}
          >
            Add to the plan
          </button>
        </li>
      ))}
    </ul>
  );
}

function Row({ accidents }: { accidents: PostureAccidents }) {
  const { leg, lost, settled } = accidents;
  return (
    <tr data-testid={`rehearsal-${leg}`}>
      <th scope="row">{capital(legLabel(leg))}</th>
      <Cell leg={leg} accident={lost} />
      <Cell leg={leg} accident={settled} />
    </tr>
  );
}

function Cell({ leg, accident }: { leg: string; accident: PostureAftermath }) {
  const { margin, status, says } = aftermathCell(accident);
  const { barrier, end } = accident.way_back;
  const why = barrier ? `: ${barrierWords(barrier).short}` : "";
  const words = capital(`${says}${why}`);
  return (
    <td
      data-status={status}
      title={words}
      onPointerEnter={() => end && lookAt(leg, end)}
      onPointerLeave={() => lookAt("", null)}
    >
      <span className="rehearsal-cell">
        <span className="num">{margin}</span>
        <StatusMark status={status} label={words} />
      </span>
    </td>
  );
}
