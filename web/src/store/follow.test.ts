import { afterEach, beforeEach, expect, it, vi } from "vitest";

import { api, ApiError } from "../api/client";
import type { PlanAnalysis, PlanAnswer, PlanRequest, Vec3 } from "../api/types";
import { useConsole } from "./console";
import { startFollowing, useFollow } from "./follow";
import { usePlan } from "./plan";
import { resetOptions, usePlanOptions } from "./planOptions";
import { useSelection } from "./selection";
import { useView } from "./view";

const before = useConsole.getState();
const asked: PlanRequest[] = [];
let fails: ApiError | null = null;
let stop = () => {};
let round = 0;

/** A rover that stands still on a map, and a server that answers after 40 ms. */
beforeEach(() => {
  vi.useFakeTimers();
  // Each test begins later than the one before has ended, as the module under test goes on.
  vi.advanceTimersByTime(10_000 * ++round);
  asked.length = 0;
  fails = null;
  vi.spyOn(api, "planAtOnce").mockImplementation(async (request) => {
    asked.push(request);
    await new Promise((resolve) => setTimeout(resolve, 40));
    if (fails) throw fails;
    return { leg: request.leg, outcome: "found" } as PlanAnalysis;
  });
  const state = {
    base: { position_m: [0, 0, 1] as Vec3, orientation_xyzw: [0, 0, 0, 1] },
    joints_rad: {},
  };
  const rover = { message: { state, mode: "idle" } } as unknown as typeof before.stream.live.rover;
  useConsole.setState({
    connection: "open",
    terrainVersion: "t1",
    stream: { ...before.stream, live: { ...before.stream.live, rover } },
  });
  useSelection.setState({ leg: "leg2", pick: null, hover: null });
  usePlan.setState({ job: null, plan: null });
  useView.setState({ follow: true });
  resetOptions();
  stop = startFollowing();
});

afterEach(() => {
  stop();
  useConsole.setState(before, true);
  vi.restoreAllMocks();
  vi.useRealTimers();
});

const point = (x: number | null) => useSelection.setState({ hover: x === null ? null : [x, 0, 0] });
const pass = (ms: number) => vi.advanceTimersByTimeAsync(ms);
const shownAt = () => useFollow.getState().shown?.target_m[0] ?? null;

it("asks for the place under the pointer, with the options of plans and little time", async () => {
  usePlanOptions.setState({ planner: "sbl" });
  point(1);
  await pass(50);
  expect(asked).toMatchObject([
    { leg: "leg2", target: { position_m: [1, 0, 0] }, planner: "sbl", deadline_s: 0.25 },
  ]);
  expect(shownAt()).toBe(1);
});

it("keeps the last answer until the next, and nothing without a pointer or with another leg", async () => {
  point(1);
  await pass(50);
  point(2);
  await pass(20);
  expect(shownAt()).toBe(1);
  await pass(60);
  expect(shownAt()).toBe(2);
  useSelection.setState({ leg: "leg3" });
  expect(shownAt()).toBeNull();
  await pass(100);
  expect(asked.at(-1)?.leg).toBe("leg3");
  expect(shownAt()).toBe(2);
  point(3);
  point(null);
  await pass(100);
  expect([shownAt(), useFollow.getState().active]).toEqual([null, false]);
});

it("asks anew where the rover or its map is another, but not where nothing changed", async () => {
  point(1);
  await pass(500);
  useConsole.setState({ liveTerrain: "t1" });
  await pass(500);
  expect(asked.length).toBe(1);
  useConsole.setState({ terrainVersion: "t2" });
  await pass(500);
  expect(asked.length).toBe(2);
});

it.each<[string, () => void]>([
  ["it is switched off", () => useView.setState({ follow: false })],
  ["no leg is chosen", () => useSelection.setState({ leg: null })],
  ["the server is gone", () => useConsole.setState({ connection: "lost" })],
  ["a plan is looked at", () => usePlan.setState({ plan: plan("found") })],
  ["a replay is shown", () => replay()],
])("asks nothing while %s", async (_, arrange) => {
  arrange();
  point(1);
  await pass(500);
  expect(asked).toEqual([]);
  expect(useFollow.getState().active).toBe(false);
});

it("goes on beside a plan that was not found", async () => {
  usePlan.setState({ plan: plan("unreachable") });
  point(1);
  await pass(50);
  expect(shownAt()).toBe(1);
});

it("asks a busy server again after a while, and tells of other failures", async () => {
  fails = new ApiError(429, { code: "busy", message: "too many" });
  point(1);
  await pass(50);
  fails = null;
  await pass(500);
  expect([asked.length, shownAt()]).toEqual([2, 1]);
  fails = new ApiError(422, { code: "leg", message: "no such leg" });
  point(2);
  await pass(500);
  expect([shownAt(), useFollow.getState().failure]).toEqual([null, "no such leg"]);
});

function plan(outcome: string): PlanAnswer {
  const parts = { commands: [{}], retreat: [{}], waypoints: [] };
  return { id: "p", leg: "leg2", outcome, ...parts } as unknown as PlanAnswer;
}

function replay(): void {
  const { stream } = useConsole.getState();
  useConsole.setState({
    stream: { ...stream, replayState: { id: "r" } as typeof stream.replayState },
  });
}
