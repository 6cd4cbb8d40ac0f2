// Stages a command by hand; and puts it into the sequence instead.

import { ListPlus } from "lucide-react";

import type { CommandBody } from "../../api/types";
import { mayBeStep } from "../../lib/sequence";
import { HAND_KEY, stageByHand, useRequests } from "../../store/commands";
import { useBlocked } from "../../store/permission";
import { addSteps, STEPS_MAX, useSequence } from "../../store/sequence";

interface Props {
  body: CommandBody | null;
  /** What it is as a step, where that differs: a step begins where the one before ends. */
  step?: CommandBody | null;
  label: string;
  testId: string;
}

export function StageButton({ body, step = body, label, testId }: Props) {
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy[HAND_KEY]);
  return (
    <span className="row stage-or-add">
      {(step === null || mayBeStep(step)) && <AddStep step={step} label={label} testId={testId} />}
      <button
        type="button"
        className="button"
        data-testid={testId}
        disabled={blocked !== null || body === null || busy}
        title={blocked ?? (body === null ? "Fill in numbers within the limits" : undefined)}
        onClick={() => body && void stageByHand(body)}
      >
        {label}
      </button>
    </span>
  );
}

function AddStep({
  step,
  label,
  testId,
}: {
  step: CommandBody | null;
  label: string;
  testId: string;
}) {
  const n = useSequence((s) => s.steps.length);
  const words = `${label.replace(/^Stage /, "").replace(/^./, (c) => c.toUpperCase())}: into the sequence`;
  return (
    <button
      type="button"
      className="button bare icon"
      data-testid={`${testId}-add`}
      aria-label={words}
      title={n < STEPS_MAX ? `${words} (${n} so far)` : `A sequence takes ${STEPS_MAX} steps`}
      disabled={step === null || n >= STEPS_MAX}
      onClick={() => step && addSteps([{ body: step }])}
    >
      <ListPlus size={15} aria-hidden />
    </button>
  );
}
