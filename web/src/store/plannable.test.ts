import { describe, expect, it } from "vitest";

import type { ReachGrid } from "../api/tiles";
import { plannedCount } from "./plannable";

/** Cells of 2 cm, 12 across: squares of 5 x 5 cells, those at the right edge narrower. */
function grid(classes: Uint8Array): ReachGrid {
  const header = { resolution_m: 0.02, size: [12, classes.length / 12] };
  return { header, classes } as unknown as ReachGrid;
}

describe("planned cells", () => {
  it("are counted, and squares that are left to plan to", () => {
    const classes = new Uint8Array(120).fill(1);
    expect(plannedCount(grid(classes), 1)).toEqual({ found: 0, none: 0, open: 0, squares: 0 });
    classes.fill(4, 0, 24);
    // Two rows of all three squares.
    expect(plannedCount(grid(classes), 1)).toEqual({ found: 0, none: 0, open: 24, squares: 3 });
    classes[2] = 6;
    classes[7] = 7;
    expect(plannedCount(grid(classes), 1)).toEqual({ found: 1, none: 1, open: 22, squares: 1 });
    // The last square is done: cells that can be reached are left, but nothing to plan to.
    classes[22] = 6;
    expect(plannedCount(grid(classes), 1)).toEqual({ found: 2, none: 1, open: 21, squares: 0 });
  });

  it("in squares that go with the robot's scale", () => {
    const classes = new Uint8Array(120).fill(4);
    expect(plannedCount(grid(classes), 2).squares).toBe(2);
    expect(plannedCount(grid(classes), 0.1).squares).toBe(120);
  });
});
