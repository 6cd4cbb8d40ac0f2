// The step: ask for a plan, read its verdict, look at its preview, release its commands.

import { RotateCcw, Trash2 } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { capital, legLabel, readable, words } from "../../lib/format";
import { useConsole, useLive } from "../../store/console";
import { useBlocked } from "../../store/permission";
import { cancelPlanning, dropPlan, makePlan, usePlan } from "../../store/plan";
import { liveBasis } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { StatusMark } from "../../ui/StatusMark";
import { PlanCommands } from "../commands/PlanCommands";
import { Findings } from "./Findings";
import { Preview } from "./Preview";
import "./plan.css";

export function PlanPanel() {
  const { job, plan, failure } = usePlan();
  return (
    <>
      <PlanRequestRow />
      {job && (
        <section className="section stack" role="status">
          <div className="row between">
            <span>{job.doing || "Waiting for a worker"}</span>
            <button
              type="button"
              className="button"
              data-testid="plan-cancel"
              onClick={cancelPlanning}
            >
              Cancel planning
            </button>
          </div>
          <div className="bar">
            <span style={{ width: `${Math.round(job.progress * 100)}%` }} />
          </div>
        </section>
      )}
      {failure && (
        <section className="section row" role="alert">
          <StatusMark status="serious" label="failed" />
          <span data-testid="plan-failure">{failure}</span>
        </section>
      )}
      {plan && <PlanView plan={plan} />}
      {!job && !plan && !failure && (
        <p className="section quiet">
          A plan brings the chosen leg to the picked place: lift, transit, drop, each checked along
          its whole way.
        </p>
      )}
    </>
  );
}

function PlanRequestRow() {
  const leg = useSelection((s) => s.leg);
  const pick = useSelection((s) => s.pick);
  const running = usePlan((s) => s.job !== null);
  const has = usePlan((s) => s.plan !== null);
  const blocked = useBlocked();
  const why =
    blocked ?? (leg === null ? "Choose a leg first" : pick === null ? "Pick a place first" : null);
  return (
    <section className="section row between">
      <button
        type="button"
        className={has ? "button" : "button primary"}
        data-testid="plan"
        disabled={why !== null || running}
        title={why ?? "Plan the step (Enter)"}
        onClick={() => leg !== null && pick && void makePlan(leg, pick)}
      >
        {has && <RotateCcw size={14} aria-hidden />}
        {leg === null ? "Plan a step" : `Plan step of ${legLabel(leg)}`}
      </button>
      {has ? (
        <button
          type="button"
          className="button bare icon"
          aria-label="Drop the plan"
          title="Drop the plan"
          data-testid="plan-drop"
          onClick={dropPlan}
        >
          <Trash2 size={16} />
        </button>
      ) : (
        why !== null && <span className="quiet small plan-why">{why}</span>
      )}
    </section>
  );
}

function PlanView({ plan }: { plan: PlanAnswer }) {
  const found = plan.outcome === "found";
  return (
    <>
      <section className="section stack">
        <div className="row">
          <StatusMark status={found ? "normal" : "serious"} label={found ? "good" : "no plan"} />
          <strong data-testid="plan-outcome">{capital(words(plan.outcome))}</strong>
          <span className="quiet small num plan-cost">
            {(
              plan.statistics.search_ms +
              plan.statistics.smoothing_ms +
              plan.statistics.check_ms
            ).toFixed(1)}{" "}
            ms · {plan.statistics.configurations_checked} checks
          </span>
        </div>
        <Outdated plan={plan} />
        {plan.reason && <p className={found ? "quiet" : ""}>{readable(plan.reason)}</p>}
      </section>
      {plan.waypoints.length > 1 && <Preview plan={plan} />}
      {plan.commands.length > 0 && <PlanCommands plan={plan} />}
      <Findings findings={plan.findings} />
      <section className="section quiet small plan-basis">
        <span>
          way <span className="num">{plan.statistics.length_rad.toFixed(2)} rad</span>, straight{" "}
          <span className="num">{plan.statistics.straight_rad.toFixed(2)} rad</span>
        </span>
        <span>
          seed <span className="num">{plan.basis.seed}</span>
        </span>
      </section>
    </>
  );
}

/** A plan is for the stance it was made for; the server refuses to arm it on another. */
function Outdated({ plan }: { plan: PlanAnswer }) {
  const of = usePlan((s) => s.basis);
  const basis = useConsole(liveBasis);
  const begun = useLive((c) => c.commands.some((k) => k.plan?.plan_id === plan.id));
  if (begun || of === null || basis === of || plan.outcome !== "found") return null;
  return (
    <p className="row trouble" data-testid="plan-outdated">
      <StatusMark status="caution" />
      Stance or map have changed since: plan again.
    </p>
  );
}
