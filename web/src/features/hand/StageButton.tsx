// Stages a command by hand.

import type { CommandBody } from "../../api/types";
import { HAND_KEY, stageByHand, useRequests } from "../../store/commands";
import { useBlocked } from "../../store/permission";

export function StageButton({
  body,
  label,
  testId,
}: {
  body: CommandBody | null;
  label: string;
  testId: string;
}) {
  const blocked = useBlocked();
  const busy = useRequests((s) => s.busy[HAND_KEY]);
  return (
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
  );
}
