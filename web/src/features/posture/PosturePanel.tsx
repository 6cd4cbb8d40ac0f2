// The posture adviser beside the plan: what to change before the chosen leg is lifted, closed until it is
// asked for.

import { ChevronDown, ChevronRight } from "lucide-react";
import type { PostureAdvice } from "../../api/types";
import { legLabel } from "../../lib/format";
import { conservativeWish, type PostureWish, USUAL_WISH, withoutLeg } from "../../lib/posture";
import { useConsole } from "../../store/console";
import { usePlanOptions } from "../../store/planOptions";
import { askAdviser, dropAdvice, offered, usePosture } from "../../store/posture";
import { shownBasis } from "../../store/reach";
import { useSelection } from "../../store/selection";
import { JobRow } from "../../ui/JobRow";
import { NumberField } from "../../ui/NumberField";
import { Segments } from "../../ui/Segments";
import { StatusMark } from "../../ui/StatusMark";
import { BestPosture, Limits, Proposal } from "./Proposal";
import "./posture.css";

export function PosturePanel() {
  const leg = useSelection((s) => s.leg);
  const open = usePosture((s) => s.open);
  if (leg === null) return null;
  const Arrow = open ? ChevronDown : ChevronRight;
  return (
    <section className="section posture" aria-label="Posture">
      <button
        type="button"
        className="posture-head"
        aria-expanded={open}
        data-testid="posture"
        title={`What to change before ${legLabel(leg)} is lifted`}
        onClick={() => usePosture.setState({ open: !open })}
      >
        <Arrow size={14} aria-hidden />
        Posture
        <Without leg={leg} />
      </button>
      {open && <Adviser key={leg} leg={leg} />}
    </section>
  );
}

/** Whether the margin rule holds as the rover stands with the leg up. */
function Without({ leg }: { leg: string }) {
  const without = usePosture((s) => s.without);
  const needed_m = useConsole((s) => s.model?.margin_m ?? 0);
  const advice = without?.leg === leg ? without.answer.advice : null;
  if (!advice) return null;
  const conservative = without?.stability === "conservative";
  const friction = without?.stability === "friction";
  const { status, says } = withoutLeg(advice, { needed_m, conservative, friction });
  return (
    <span
      className="quiet small posture-without"
      data-testid="posture-without"
      data-status={status}
    >
      <StatusMark status={status} />
      {says}
    </span>
  );
}

function Adviser({ leg }: { leg: string }) {
  const { asking, answer, failure } = usePosture();
  return (
    <div className="stack posture-body">
      <Wish />
      {asking ? (
        <JobRow
          job={asking.job}
          waiting="Looking for postures"
          cancel={dropAdvice}
          testId="posture-asking"
        />
      ) : (
        <div className="row between">
          <button
            type="button"
            className={answer ? "button" : "button primary"}
            data-testid="posture-ask"
            onClick={() => void askAdviser(leg)}
          >
            {answer ? "Ask again" : "Ask the adviser"}
          </button>
          {!answer && !failure && <span className="quiet small">a few seconds</span>}
        </div>
      )}
      {failure && (
        <p className="row" role="alert">
          <StatusMark status="serious" label="failed" />
          <span data-testid="posture-failure">{failure}</span>
        </p>
      )}
      {answer?.advice && <Answer advice={answer.advice} />}
    </div>
  );
}

function Wish() {
  const wish = usePosture((s) => s.wish);
  const rule_m = useConsole((s) => s.model?.margin_m ?? 0);
  const byPreference = usePlanOptions((options) => conservativeWish(USUAL_WISH, options));
  const set = (change: Partial<PostureWish>) =>
    usePosture.setState((s) => ({ wish: { ...s.wish, ...change } }));
  return (
    <>
      <div className="posture-wish">
        <NumberField
          label="Margin wanted (m)"
          title={`Regular margin without the leg; the rule's ${rule_m.toFixed(2)} m where that is more`}
          testId="posture-regular"
          value={wish.regular_m}
          usual={rule_m.toFixed(2)}
          step={0.05}
          max={10}
          set={(regular_m) => set({ regular_m })}
        />
        <NumberField
          label="Conservative (m)"
          title="Margin that is left should one more leg be lost; where nothing is filled in the preference of plans decides"
          testId="posture-conservative"
          value={wish.conservative_m}
          usual={byPreference === null ? "not asked for" : byPreference.toFixed(2)}
          step={0.05}
          max={10}
          set={(conservative_m) => set({ conservative_m })}
        />
      </div>
      <Segments
        name="posture-chassis"
        label="How the chassis may move"
        choices={[
          ["whole", "Chassis all ways", "The chassis may rise, lean and turn too"],
          ["level", "Chassis level", "The chassis keeps its height and attitude"],
        ]}
        value={wish.chassis}
        set={(chassis) => set({ chassis })}
        testId="posture-chassis"
      />
      <div className="row between">
        <Check label="Fold the leg first" on={wish.fold} set={(fold) => set({ fold })} />
        <Check label="Move another foot" on={wish.replace} set={(replace) => set({ replace })} />
      </div>
    </>
  );
}

function Check(props: { label: string; on: boolean; set: (on: boolean) => void }) {
  return (
    <label className="check posture-check">
      <input
        type="checkbox"
        checked={props.on}
        onChange={(event) => props.set(event.target.checked)}
      />
      {props.label}
    </label>
  );
}

function Answer({ advice }: { advice: PostureAdvice }) {
  const answer = usePosture((s) => s.answer);
  const basis = usePosture((s) => s.basis);
  const old = useConsole(shownBasis) !== basis;
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const wish = usePosture((s) => s.wish);
  const usual = JSON.stringify(wish) === JSON.stringify(USUAL_WISH);
  return (
    <div className="stack" data-testid="posture-answer" data-outcome={advice.outcome}>
      {old && (
        <p className="row trouble">
          <StatusMark status="caution" />
          Stance or map have changed since: ask again.
        </p>
      )}
      {advice.outcome === "already_met" && (
        <p className="row">
          <StatusMark status="normal" />
          {usual
            ? `The margin rule holds without ${legLabel(advice.leg)}: nothing has to move.`
            : "The wish is met as the rover stands."}
        </p>
      )}
      {advice.best && <BestPosture best={advice.best} />}
      {replaying && offered(answer).length > 0 && (
        <p className="quiet small">Of a replay: to look at, not to take up.</p>
      )}
      <ul className="proposals">
        {offered(answer).map((proposal, i) => (
          <Proposal
            key={i}
            index={i}
            advice={advice}
            proposal={proposal}
            old={old}
            best={advice.outcome === "best"}
          />
        ))}
      </ul>
      {advice.outcome !== "already_met" && <Limits advice={advice} />}
    </div>
  );
}
