// The step: ask for a plan, read its verdict, look at its preview, release its commands.

import { RotateCcw, Trash2 } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { capital, legLabel, metres, readable, words } from "../../lib/format";
import {
  inTheWay,
  milliseconds,
  missingFigure,
  plannerName,
  tookMs,
  whySentence,
} from "../../lib/planWords";
import { useConsole, useLive } from "../../store/console";
import { useBlocked } from "../../store/permission";
import { keepsFollowing } from "../../store/follow";
import { cancelPlanning, dropPlan, makePlan, usePlan } from "../../store/plan";
import { liveBasis } from "../../store/reach";
import { pickAt, useSelection } from "../../store/selection";
import { useView } from "../../store/view";
import { StatusMark } from "../../ui/StatusMark";
import { PosturePanel } from "../posture/PosturePanel";
import { PlanCommands } from "../commands/PlanCommands";
import { Findings } from "./Findings";
import { PlanOptions } from "./PlanOptions";
import { Preview } from "./Preview";
import { WayBack } from "./WayBack";
import "./plan.css";

export function PlanPanel() {
  const { job, plan, failure } = usePlan();
  return (
    <>
      <PlanRequestRow />
      <PlanSettings />
      <PosturePanel />
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
          A plan brings the chosen leg to the picked place: a body shift where it is needed, lift,
          transit, drop and preload, each checked along its whole way.
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

/** How plans come about: with the pointer or when asked, and by which options. */
function PlanSettings() {
  const follow = useView((s) => s.follow);
  const plan = usePlan((s) => s.plan);
  const paused = useLive((c) => !keepsFollowing(plan, c.commands));
  return (
    <section className="section plan-settings" aria-label="Plan settings">
      <label className="check" title="Show the step to the place under the pointer (h)">
        <input
          type="checkbox"
          data-testid="follow-toggle"
          checked={follow}
          onChange={(event) => useView.setState({ follow: event.target.checked })}
        />
        Follow the pointer
        {follow && paused && (
          <span className="quiet small" title="Goes on when the plan is dropped or done">
            after this plan
          </span>
        )}
        <kbd>h</kbd>
      </label>
      <PlanOptions />
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
          <strong data-testid="plan-outcome">
            {plan.posture
              ? plan.posture.accident
                ? "Way back"
                : "Posture"
              : capital(words(plan.outcome))}
          </strong>
          {!plan.posture && (
            <span className="quiet small num plan-cost">
              {milliseconds(tookMs(plan.statistics))}
            </span>
          )}
        </div>
        <Outdated plan={plan} />
        {found ? (
          plan.reason && <p className="quiet">{capital(readable(plan.reason))}.</p>
        ) : (
          <Missing plan={plan} />
        )}
      </section>
      {plan.waypoints.length > 1 && <Preview plan={plan} />}
      {plan.commands.length > 0 && <PlanCommands plan={plan} />}
      {found && <WayBack plan={plan} />}
      <Findings findings={plan.findings} />
      {!plan.posture && <Work plan={plan} />}
    </>
  );
}

/** What is in the way of a step, how much is missing, and where it would do. */
function Missing({ plan }: { plan: PlanAnswer }) {
  const leg = useSelection((s) => s.leg);
  const figure = missingFigure(plan);
  const near = plan.nearest_m;
  const target = plan.target_m;
  const why = whySentence(plan);
  return (
    <>
      {plan.constraint && (
        <p className="row between plan-missing" data-testid="plan-constraint">
          <span>
            {capital(inTheWay({ ...plan, constraint: { ...plan.constraint, missing: null } }))}
          </span>
          {figure && (
            <span className="num" title="What is missing">
              {figure}
            </span>
          )}
        </p>
      )}
      {why && <p className={plan.constraint ? "quiet" : ""}>{why}</p>}
      {near && (
        <div className="row between">
          <span className="quiet small">
            {target && `${metres(Math.hypot(near[0] - target[0], near[1] - target[1]))} away`}
          </span>
          <button
            type="button"
            className="button"
            data-testid="use-nearest"
            disabled={leg !== plan.leg}
            onClick={() => pickAt(near)}
          >
            Use nearest place
          </button>
        </div>
      )}
    </>
  );
}

const count = (n: number) => n.toLocaleString("en").replaceAll(",", "\u202f");

/** How the plan was come by. */
function Work({ plan }: { plan: PlanAnswer }) {
  const { statistics, basis } = plan;
  const planner = plannerName(statistics);
  return (
    <dl className="section quiet small plan-work" data-testid="plan-work">
      {planner && (
        <div>
          <dt>Planner</dt>
          <dd>
            {planner}
            {plan.outcome === "found" &&
              (statistics.certified ? ", certified" : ", checked at a resolution")}
          </dd>
        </div>
      )}
      {statistics.length_rad > 0 && (
        <div>
          <dt>Way</dt>
          <dd className="num">
            {statistics.length_rad.toFixed(2)} rad, straight {statistics.straight_rad.toFixed(2)}
          </dd>
        </div>
      )}
      <div>
        <dt>Checked</dt>
        <dd className="num">
          {count(statistics.configurations_checked)} poses, {count(statistics.edges)} edges
        </dd>
      </div>
      <div>
        <dt>Seed</dt>
        <dd className="num">{basis.seed}</dd>
      </div>
    </dl>
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
