import { expect, it } from "vitest";

import { stageOf } from "./reimage";

it("goes from lift over asking to place, and begins anew where the leg came down too early", () => {
  const stage = (lifted_ms: number | null, captured_ms: number | null, placed_ms: number | null) =>
    stageOf({ lifted_ms, captured_ms, placed_ms });
  expect(stage(null, null, null)).toBe("lift");
  expect(stage(null, 5, null)).toBe("lift");
  expect(stage(10, null, null)).toBe("ask");
  expect(stage(10, 5, null)).toBe("ask");
  expect(stage(10, 12, null)).toBe("place");
  expect(stage(10, 12, 20)).toBe("done");
  expect(stage(10, 5, 20)).toBe("lift");
  expect(stage(10, 25, 20)).toBe("lift");
});
