import { expect, test } from "vitest";

import type { CommandRecord } from "../api/types";
import { approvalLine, approvalView, awaitsApproval, mayApprove } from "./approval";

const NOW = Date.parse("2026-11-23T12:00:00Z");
const command = (approval: CommandRecord["approval"], more: Partial<CommandRecord> = {}) =>
  ({ state: "staged", operator: "ada", approval, ...more }) as CommandRecord;
const waits = command({ content_hash: "ab" });
const given = command({ content_hash: "ab", by: "bob", until: "2026-11-23T12:10:00Z" });

test("a command that takes no second person waits for none", () => {
  const free = command(undefined);
  expect(approvalView(free, NOW).state).toBe("not_needed");
  expect([awaitsApproval(free, NOW), approvalLine(free, NOW)]).toEqual([null, null]);
  expect(mayApprove(free, "bob", NOW)).toBe(false);
});

test("it waits for another than its author", () => {
  expect(awaitsApproval(waits, NOW)).toMatch(/second person/);
  expect(mayApprove(waits, "bob", NOW)).toBe(true);
  expect(mayApprove(waits, "ada", NOW)).toBe(false);
  expect(mayApprove(command(waits.approval, { state: "cancelled" }), "bob", NOW)).toBe(false);
});

test("an approval holds until its end, and must be given again after it", () => {
  expect(approvalView(given, NOW)).toEqual({ state: "approved", by: "bob", left_s: 600 });
  expect(awaitsApproval(given, NOW)).toBeNull();
  expect(approvalLine(given, NOW)).toBe("approved by bob, holds 10:00");
  expect(mayApprove(given, "eve", NOW)).toBe(false);
  const later = NOW + 600_000;
  expect(approvalView(given, later).state).toBe("lapsed");
  expect(awaitsApproval(given, later)).toMatch(/approval of bob has lapsed/);
  expect(mayApprove(given, "eve", later)).toBe(true);
});
