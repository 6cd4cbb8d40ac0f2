// Lift the leg, ask the pairs again, place it: offered for ground that a leg hides.

import { Check, X } from "lucide-react";

import type { CameraAnswer } from "../../api/types";
import { cameraLabel, intoBase, looksAt } from "../../lib/cameras";
import { capital, legLabel } from "../../lib/format";
import type { ReimageStage } from "../../lib/reimage";
import { askPairs, choose, chosenCameras, useCameras } from "../../store/cameras";
import { useConsole, useLive } from "../../store/console";
import { useBlocked } from "../../store/permission";
import { makePlan, usePlan } from "../../store/plan";
import { offerReimage, useReimage, useReimageStage } from "../../store/reimage";
import { useSelection } from "../../store/selection";
import { useView } from "../../store/view";

const STAGES: [ReimageStage, string][] = [
  ["lift", "Lift"],
  ["ask", "Look again"],
  ["place", "Place"],
];

export function Reimage() {
  const of = useReimage((s) => s.leg);
  const selected = useSelection((s) => s.leg);
  if (of === null) {
    return selected === null ? null : (
      <section className="section">
        <button
          type="button"
          className="button bare reimage-offer"
          data-testid="reimage-offer"
          title="Lift the leg, look at the ground that it hides, place it there"
          onClick={() => offerReimage(selected)}
        >
          See what {legLabel(selected)} hides…
        </button>
      </section>
    );
  }
  return <Sequence leg={of} />;
}

function Sequence({ leg }: { leg: string }) {
  const stage = useReimageStage();
  const at = STAGES.findIndex(([value]) => value === stage);
  return (
    <section
      className="section stack"
      aria-label={`What ${legLabel(leg)} hides`}
      data-testid="reimage"
      data-stage={stage}
    >
      <div className="row between">
        <h2>What {legLabel(leg)} hides</h2>
        <button
          type="button"
          className="button bare icon"
          aria-label="Leave the sequence"
          title="Leave the sequence"
          onClick={() => offerReimage(null)}
        >
          <X size={14} />
        </button>
      </div>
      <ol className="reimage-stages">
        {STAGES.map(([value, name], i) => {
          const past = stage === "done" || i < at;
          return (
            <li key={value} className={past ? "past" : i === at ? "now" : ""}>
              <span className="reimage-mark">{past ? <Check size={12} /> : i + 1}</span>
              {name}
            </li>
          );
        })}
      </ol>
      {stage === "lift" && <Lift leg={leg} />}
      {stage === "ask" && <Ask leg={leg} />}
      {stage === "place" && <Place leg={leg} />}
      {stage === "done" && (
        <p className="small">{capital(legLabel(leg))} stands on ground that was looked at.</p>
      )}
    </section>
  );
}

/** Plans a step of the leg to the pick; of its commands only the lift is to be sent. */
function Lift({ leg }: { leg: string }) {
  return (
    <>
      <p className="small quiet">
        Plan a step, and send its lift only. What the leg hid can be seen then.
      </p>
      <PlanButton leg={leg} label="Plan the lift" testId="reimage-lift" />
    </>
  );
}

function Place({ leg }: { leg: string }) {
  return (
    <>
      <p className="small quiet">
        The map has changed, so the rest of the step is planned anew, on ground that was seen.
      </p>
      <PlanButton leg={leg} label="Plan the rest" testId="reimage-place" />
    </>
  );
}

function PlanButton({ leg, label, testId }: { leg: string; label: string; testId: string }) {
  const selected = useSelection((s) => s.leg);
  const pick = useSelection((s) => s.pick);
  const running = usePlan((s) => s.job !== null);
  const blocked = useBlocked();
  const why =
    blocked ??
    (selected !== leg
      ? `Choose ${legLabel(leg)} first`
      : pick === null
        ? "Pick a place first"
        : running
          ? "A plan is being made"
          : null);
  return (
    <div className="row between">
      <button
        type="button"
        className="button primary"
        data-testid={testId}
        disabled={why !== null}
        title={why ?? ""}
        onClick={() => {
          if (!pick) return;
          useView.setState({ tab: "step" });
          void makePlan(leg, pick);
        }}
      >
        {label}
      </button>
      {why && <span className="quiet small">{why}</span>}
    </div>
  );
}

/** The pairs that look at what was hidden or at the pick; else those that are chosen. */
function Ask({ leg }: { leg: string }) {
  const state = useCameras();
  const hole = useReimage((s) => s.hole);
  const pick = useSelection((s) => (s.leg === leg ? s.pick : null));
  const rover = useLive((c) => c.rover?.message ?? null);
  const connected = useConsole((s) => s.connection === "open");
  const points = [hole, pick, rover?.contact_points_m[leg]].filter((p) => p != null);
  const looks = (camera: CameraAnswer) =>
    rover !== null && points.some((p) => looksAt(camera, intoBase(rover.state.base, p)));
  const looking = (state.cameras ?? []).filter(looks);
  const near = looking.length > 0 ? looking : chosenCameras(state);
  const names = near.map((c) => c.name);
  if (near.length === 0) {
    return <p className="small quiet">No pair looks there: choose pairs above, and ask them.</p>;
  }
  return (
    <div className="row between">
      <button
        type="button"
        className="button primary"
        data-testid="reimage-ask"
        disabled={state.asking !== null || !connected}
        onClick={() => {
          choose(names);
          void askPairs();
        }}
      >
        Ask {near.length === 1 ? "1 pair" : `${near.length} pairs`}
      </button>
      <span className="quiet small">{names.map(cameraLabel).join(", ")}</span>
    </div>
  );
}
