// What the adviser offers: what moves, what it costs, what it gives. The pointer on it shows its ghost.

import { useState } from "react";

import type { PostureAdvice, PostureBarrier, PostureProposal } from "../../api/types";
import { metres } from "../../lib/format";
import { barrierWords, changeName, costWords, marginPairs } from "../../lib/posture";
import { formatSpan } from "../../lib/time";
import { useBlocked } from "../../store/permission";
import { lookAt, takeUp, usePosture } from "../../store/posture";
import { StatusMark } from "../../ui/StatusMark";

interface Props {
  index: number;
  advice: PostureAdvice;
  proposal: PostureProposal;
  /** The stance is another one since. */
  old: boolean;
  /** It does not meet the wish. */
  best: boolean;
}

export function Proposal({ index, advice, proposal, old, best }: Props) {
  const blocked = useBlocked();
  const taking = usePosture((s) => s.taking);
  const why = blocked ?? (old ? "The stance has changed since: ask again" : null);
  const look = () => lookAt(proposal.leg, proposal.end);
  const away = () => lookAt("", null);
  return (
    <li
      className="proposal"
      data-testid={`proposal-${index}`}
      data-change={proposal.change}
      onPointerEnter={look}
      onPointerLeave={away}
      onFocus={look}
      onBlur={away}
    >
      <div className="row between">
        <strong>{changeName(proposal, advice.leg)}</strong>
        <span className="num quiet" title="Time that the motions take">
          {formatSpan(proposal.cost.duration_s)}
        </span>
      </div>
      <p className="quiet small num">{costWords(proposal)}</p>
      <MarginChange advice={advice} proposal={proposal} />
      <button
        type="button"
        className={index === 0 && !best ? "button primary" : "button"}
        data-testid={`take-up-${index}`}
        disabled={why !== null || taking !== null}
        title={why ?? "Make it the plan: it is then staged, armed and sent like any other"}
        onClick={() => void takeUp(index)}
      >
        {best ? "Go there anyway" : "Add to the plan"}
      </button>
    </li>
  );
}

/** Margins without the leg, as the rover stands and in the posture. */
function MarginChange({ advice, proposal }: Pick<Props, "advice" | "proposal">) {
  return (
    <table className="margin-change">
      <thead className="sr">
        <tr>
          <th scope="col">Margin without the leg</th>
          <th scope="col">now</th>
          <th />
          <th scope="col">then</th>
        </tr>
      </thead>
      <tbody>
        {marginPairs(advice.before, proposal.margins).map((pair) => (
          <tr key={pair.key}>
            <th scope="row">{pair.name}</th>
            <td className="num quiet">{pair.before}</td>
            <td className="quiet" aria-hidden>
              →
            </td>
            <td className={pair.more === null ? "num quiet" : "num"} data-more={pair.more}>
              {pair.after}
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** Where the wish cannot be met: how much is missing at best, and what stands in the way. */
export function BestPosture({ best }: { best: NonNullable<PostureAdvice["best"]> }) {
  const { short, detail } = barrierWords(best.barrier);
  return (
    <div className="stack best-posture" data-testid="best-posture">
      <p className="row between">
        <span className="row">
          <StatusMark status="caution" />
          <strong>Best possible</strong>
        </span>
        <span className="num" title="What is missing there of what is wanted">
          {best.missing_m == null ? "no margin" : `${metres(best.missing_m)} short`}
        </span>
      </p>
      <p>
        {short}. {detail && <span className="quiet">{detail}.</span>}
      </p>
      {best.posture.commands.length === 0 && (
        <p className="quiet small">
          It is where the rover stands: no change of posture gives more.
        </p>
      )}
    </div>
  );
}

/** What the other kinds of change run into. */
export function Limits({ advice }: { advice: PostureAdvice }) {
  const [open, setOpen] = useState(false);
  const { limits } = advice;
  if (limits.length === 0) return null;
  return (
    <div>
      <button
        type="button"
        className="button bare limits-open"
        aria-expanded={open}
        data-testid="posture-limits"
        onClick={() => setOpen(!open)}
      >
        {open ? "Hide what stands in the way" : "What stands in the way of other changes"}
      </button>
      {open && (
        <ul className="limits small">
          {limits.map((limit, i) => (
            <li key={i}>
              <p className="row between">
                <span>{changeName(limit, advice.leg)}</span>
                <span className="num quiet">{metres(limit.margins?.regular_m)}</span>
              </p>
              <BarrierLine barrier={limit.barrier} />
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}

function BarrierLine({ barrier }: { barrier: PostureBarrier }) {
  const { short, missing, detail } = barrierWords(barrier);
  return (
    <p className="quiet" title={detail ?? undefined}>
      {short}
      {missing && ` by ${missing}`}
    </p>
  );
}
