import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";

import { Latest } from "./latest";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

/** Questions are numbers; each is answered after `takes_ms` by itself, negative ones fail. */
function made(takes_ms: number) {
  const asked: [number, number][] = [];
  const told: string[] = [];
  const start = Date.now();
  const latest = new Latest<number, number>({
    ask: (q, signal) => {
      asked.push([Date.now() - start, q]);
      return new Promise((resolve, reject) => {
        signal.addEventListener("abort", () => reject(new Error("taken back")));
        setTimeout(() => (q < 0 ? reject(new Error("no")) : resolve(q)), takes_ms);
      });
    },
    answered: (q, a) => told.push(`${q}=${a}`),
    failed: (q) => told.push(`${q} failed`),
    late: (late) => told.push(late ? "late" : "in time"),
    interval_ms: 50,
    late_ms: 200,
    pause_ms: 400,
    now: () => Date.now(),
  });
  return { latest, asked, told };
}

const pass = (ms: number) => vi.advanceTimersByTimeAsync(ms);

describe("the latest question", () => {
  it("goes at once; those that come while it is under way leave only the last", async () => {
    const { latest, asked, told } = made(80);
    for (const q of [1, 2, 3, 4]) latest.want(q);
    await pass(200);
    expect(asked).toEqual([
      [0, 1],
      [80, 4],
    ]);
    expect(told).toEqual(["1=1", "4=4"]);
  });

  it("is not asked more often than the interval", async () => {
    const { latest, asked } = made(5);
    for (let q = 0; q < 20; q++) {
      latest.want(q);
      await pass(10);
    }
    expect(asked).toEqual([
      [0, 0],
      [50, 4],
      [100, 9],
      [150, 14],
      [200, 19],
    ]);
  });

  it("is dropped with its answer when it is no longer wanted", async () => {
    const { latest, asked, told } = made(80);
    latest.want(1);
    latest.want(2);
    await pass(40);
    latest.stop();
    await pass(500);
    expect(asked).toEqual([[0, 1]]);
    expect(told).toEqual([]);
    latest.want(3);
    await pass(80);
    expect(told).toEqual(["3=3"]);
  });

  it("is called late when no answer has come for a while, until one is up to date", async () => {
    const { latest, told } = made(250);
    latest.want(1);
    await pass(210);
    latest.want(2);
    expect(told).toEqual(["late"]);
    await pass(50);
    expect(told).toEqual(["late", "1=1"]);
    await pass(250);
    expect(told).toEqual(["late", "1=1", "in time", "2=2"]);
  });

  it("is not called late while answers keep coming", async () => {
    const { latest, told } = made(100);
    for (let q = 0; q < 40; q++) {
      latest.want(q);
      await pass(20);
    }
    expect(told).not.toContain("late");
    expect(told.length).toBeGreaterThan(6);
  });

  it("waits after a failure, then asks what is wanted by then", async () => {
    const { latest, asked, told } = made(20);
    latest.want(-1);
    await pass(30);
    latest.want(2);
    latest.want(3);
    await pass(380);
    expect(asked).toEqual([[0, -1]]);
    await pass(50);
    expect(asked).toEqual([
      [0, -1],
      [420, 3],
    ]);
    expect(told).toEqual(["-1 failed", "late", "in time", "3=3"]);
  });
});
