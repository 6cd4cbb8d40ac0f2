import { describe, expect, it } from "vitest";

import type { CommandRecord, CommandState, JobReport, PlanAnswer, RoverState } from "../api/types";
import { planProgress } from "./planProgress";
import { jointsAt, predictedPose, type StepInputs, stepOf } from "./step";

const T0 = Date.UTC(2026, 10, 23, 15);
const at = (s: number) => new Date(T0 + 1000 * s).toISOString();

const knots = [
  { joints_rad: [0, 0], time_s: 0 },
  { joints_rad: [1, -2], time_s: 4 },
];

function record(state: CommandState, index = 0, retreat = false): CommandRecord {
  return {
    id: `c${index}`,
    body: { type: "joint_path", leg: "leg2", knots },
    title: "Lift leg 2",
    plan: { plan_id: "p", index, retreat },
    state,
    operator: "o",
    staged: at(0),
    armed_until: at(30),
    sent: at(0),
    arrives: at(1.3),
    earliest_ack: at(2.6),
    overdue_after: at(6),
    duration_s: 4,
    progress: 0,
  };
}

const plan = {
  id: "p",
  outcome: "found",
  waypoints: [],
  reason: null,
  leg: "leg2",
  findings: [{ check: "margin", ok: true, margin: 0.2 }],
  commands: ["Lift leg 2", "Move leg 2 across", "Put leg 2 down"].map((title) => ({ title })),
  retreat: ["Lift leg 2 again", "Move leg 2 back", "Put leg 2 back"].map((title) => ({ title })),
} as unknown as PlanAnswer;

function look({ commands = [], ...inputs }: Partial<StepInputs> & { commands?: CommandRecord[] }) {
  const { stage, yours, trouble } = stepOf({
    leg: null,
    picked: false,
    job: null,
    plan: null,
    progress: inputs.plan ? planProgress(inputs.plan, commands) : null,
    byHand: null,
    now_ms: T0 + 500,
    ...inputs,
  });
  return `${stage}${yours ? "" : " waits"}${trouble ? " trouble" : ""}`;
}

const job = (state: JobReport["state"]) =>
  ({ id: "j", kind: "plan", state, progress: 0.4, doing: "searching" }) as JobReport;

describe("a step goes from left to right", () => {
  const chosen = { leg: "leg2", picked: true };
  const story: [string, Parameters<typeof look>[0]][] = [
    ["pick", {}],
    ["pick", { leg: "leg2" }],
    ["plan", chosen],
    ["plan waits", { ...chosen, job: job("running") }],
    ["check", { ...chosen, plan }],
    ["arm", { ...chosen, plan, commands: [record("staged")] }],
    ["send", { ...chosen, plan, commands: [record("armed")] }],
    ["send waits", { ...chosen, plan, commands: [record("sent")] }],
    ["executing waits", { ...chosen, plan, commands: [record("executing")] }],
    ["arm", { ...chosen, plan, commands: [record("done")] }],
    ["send waits", { ...chosen, plan, commands: [record("done"), record("sent", 1)] }],
    ["done", { ...chosen, plan, commands: [0, 1, 2].map((i) => record("done", i)) }],
    ["arm", { ...chosen, plan, commands: [record("done"), record("staged", 2, true)] }],
    ["send waits", { ...chosen, plan, commands: [record("done"), record("sent", 2, true)] }],
    ["done", { ...chosen, plan, commands: [record("done"), record("done", 2, true)] }],
    [
      "arm",
      { ...chosen, plan, commands: [record("done"), record("done", 1), record("done", 1, true)] },
    ],
  ];
  it.each(story.map(([stage, inputs], i) => [i, stage, inputs] as const))(
    "moment %i: %s",
    (_, stage, inputs) => expect(look(inputs)).toBe(stage),
  );
});

describe("trouble is told where it is", () => {
  it.each<[string, Parameters<typeof look>[0]]>([
    ["plan trouble", { job: job("failed") }],
    ["check trouble", { plan: { ...plan, outcome: "unreachable" } as PlanAnswer }],
    ["send trouble", { plan, commands: [record("overdue")] }],
    ["arm trouble", { plan, commands: [record("expired")] }],
    ["arm trouble", { plan, commands: [record("failed")] }],
    ["arm trouble", { plan, commands: [record("done"), record("failed", 2, true)] }],
    ["arm", { plan, commands: [record("armed")], now_ms: T0 + 31_000 }],
  ])("%s", (stage, inputs) => expect(look(inputs)).toBe(stage));

  it("says what comes after a posture that was taken", () => {
    const posture = { leg: "leg3", change: "chassis", wish_met: true } as const;
    const of = { ...plan, posture, commands: [plan.commands[0]!] };
    const done = [record("done")];
    const progress = planProgress(of, done);
    const inputs = { leg: "leg3", picked: true, job: null, plan: of, progress, byHand: null };
    const { stage, sentence } = stepOf({ ...inputs, now_ms: T0 });
    expect([stage, sentence]).toEqual(["done", "The posture is taken: plan the step of leg 3."]);
  });

  it("a command by hand comes before the plan", () => {
    expect(look({ plan, byHand: record("executing") })).toBe("executing waits");
  });
});

describe("dead reckoning", () => {
  it("is joint-linear between knots and holds at the ends", () => {
    expect(jointsAt(knots, -1)).toEqual([0, 0]);
    expect(jointsAt(knots, 1)).toEqual([0.25, -0.5]);
    expect(jointsAt(knots, 9)).toEqual([1, -2]);
    expect(jointsAt([], 1)).toEqual([]);
  });

  it("starts when the command arrives, and says nothing of what is not under way", () => {
    expect(predictedPose(record("sent"), T0 + 1000)).toBeNull();
    expect(predictedPose(record("sent"), T0 + 3300)?.joints_rad).toEqual([0.5, -1]);
    expect(predictedPose(record("done"), T0 + 3300)).toBeNull();
    expect(predictedPose(record("overdue"), T0 + 9300)).toBeNull();
  });

  it("carries the base through a body shift and back", () => {
    const at_x = (x: number) =>
      ({
        base: { position_m: [x, 0, 1], orientation_xyzw: [0, 0, 0, 1] },
        joints_rad: { leg2: [x] },
      }) as unknown as RoverState;
    const waypoints = [0, 4, 6, 10].map((time_s) => {
      const x = 0.1 * (time_s < 5 ? time_s : time_s - 2);
      return { joints_rad: [x], phase: "shift", time_s, stance: at_x(x), hold: true };
    });
    // Two shifts, and two seconds between them in which a leg moves.
    const commands = [4, 2, 4].map((duration_s) => ({ title: "", duration_s }));
    const shifting = { ...plan, waypoints, commands } as unknown as PlanAnswer;
    const knots = waypoints.map(({ stance, time_s }) => ({
      joints_rad: stance.joints_rad,
      time_s,
    }));
    const command = (retreat: boolean, index = retreat ? 2 : 0): CommandRecord => ({
      ...record("executing", index, retreat),
      body: { type: "body_path", knots, drive_hold: false },
    });
    const x = (retreat: boolean, s: number, index?: number) =>
      predictedPose(command(retreat, index), T0 + 1300 + 1000 * s, shifting)?.stance?.base
        .position_m[0];
    expect(x(false, 1)).toBeCloseTo(0.1, 9);
    expect(x(false, 9)).toBeCloseTo(0.4, 9);
    expect(x(true, 1)).toBeCloseTo(0.3, 9);
    expect(x(true, 9)).toBeCloseTo(0, 9);
    expect(x(false, 1, 2)).toBeCloseTo(0.5, 9);
    expect(x(true, 1, 0)).toBeCloseTo(0.7, 9);
    expect(predictedPose(command(false), T0 + 2300, plan)).toBeNull();
    expect(predictedPose(command(false), T0 + 2300)).toBeNull();
  });
});

it("what holds on an assumption only is said before anything is staged", () => {
  const sentence = (...findings: object[]) => {
    const told = { ...plan, findings } as unknown as PlanAnswer;
    const inputs = { leg: "leg2", picked: true, job: null, byHand: null, now_ms: T0 };
    return stepOf({ ...inputs, plan: told, progress: planProgress(told, []) }).sentence;
  };
  const margin = { check: "margin", ok: true };
  const ground = { check: "unknown_ground", ok: true, assumed: true };
  expect(sentence(margin)).toContain("all checks hold: look");
  expect(sentence(margin, ground)).toContain("all checks hold, 1 on an assumption: look");
  expect(sentence({ ...margin, ok: false }, ground)).toContain("checks do not hold");
});
