// Takes the commands of a plan into the sequence that is being put together.

import { ListPlus } from "lucide-react";

import type { PlanAnswer } from "../../api/types";
import { addSteps } from "../../store/sequence";
import { useView } from "../../store/view";

export function AddToSequence({ plan }: { plan: PlanAnswer }) {
  if (plan.outcome !== "found" || plan.commands.length === 0) return null;
  return (
    <p className="row sequence-take">
      <button
        type="button"
        className="button bare"
        data-testid="plan-to-sequence"
        title="Put these commands into a sequence, to be sent as one"
        onClick={() => {
          addSteps(plan.commands, plan.basis.terrain_version);
          useView.setState({ tab: "hand", handPart: "sequence", rightOpen: true });
        }}
      >
        <ListPlus size={14} aria-hidden />
        Into a sequence
      </button>
    </p>
  );
}
