import { describe, expect, it } from "vitest";

import type { CommandRecord, CommandState, PlanAnswer } from "../api/types";
import { isBegun, isOver, planProgress } from "./planProgress";

const plan = { id: "p", commands: [{}, {}, {}], retreat: [{}, {}, {}] } as unknown as PlanAnswer;

function record(state: CommandState, index: number, retreat?: boolean): CommandRecord {
  return { id: `${index}`, state, plan: { plan_id: "p", index, retreat } } as CommandRecord;
}

function look(...records: CommandRecord[]) {
  const progress = planProgress(plan, records);
  const { done, backingOut, turned, underWay } = progress;
  const words = { backingOut, turned, underWay, begun: isBegun(progress), over: isOver(progress) };
  const told = Object.entries(words).filter(([, is]) => is);
  return [done, ...told.map(([word]) => word)].join(" ");
}

const there = [record("done", 0), record("done", 1)];

describe("a plan's progress", () => {
  it.each<[string, CommandRecord[]]>([
    ["0", []],
    ["0 begun", [record("staged", 0)]],
    ["0", [record("cancelled", 0)]],
    ["2 begun", there],
    ["2 underWay begun", [...there, record("executing", 2)]],
    ["3 begun over", [...there, record("done", 2)]],
    ["2 turned begun", [...there, record("staged", 1, true)]],
    ["2 begun", [...there, record("expired", 1, true)]],
    ["1 backingOut turned begun", [...there, record("done", 1, true)]],
    [
      "0 backingOut turned begun over",
      [...there, record("done", 1, true), record("done", 2, true)],
    ],
    ["3 turned begun", [...there, record("done", 2), record("armed", 0, true)]],
  ])("%s", (said, records) => expect(look(...records)).toBe(said));
});
