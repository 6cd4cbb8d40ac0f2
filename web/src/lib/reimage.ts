// How far the sequence "lift the leg, ask again, place it" is.

export type ReimageStage = "lift" | "ask" | "place" | "done";

interface Times {
  /** When the leg left the ground, the newest capture was taken, and the leg came down again (ms). */
  lifted_ms: number | null;
  captured_ms: number | null;
  placed_ms: number | null;
}

export function stageOf({ lifted_ms, captured_ms, placed_ms }: Times): ReimageStage {
  const captured = lifted_ms !== null && captured_ms !== null && captured_ms >= lifted_ms;
  if (lifted_ms === null) return "lift";
  if (placed_ms === null) return captured ? "place" : "ask";
  // Put down before the ground was seen: from the beginning.
  return captured && captured_ms <= placed_ms ? "done" : "lift";
}
