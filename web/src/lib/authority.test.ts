import { describe, expect, test } from "vitest";

import type { AuthorityReport } from "../api/types";
import { authorityView, leaseSentence, renewEvery_ms, withoutAuthority } from "./authority";

const NOW = Date.parse("2026-11-23T12:00:00Z");
const report = (more: Partial<AuthorityReport> = {}): AuthorityReport => ({
  epoch: 7,
  explicit: false,
  lease_s: 30,
  ...more,
});
const held = report({ holder: "ada", until: "2026-11-23T12:00:12Z" });

describe("who may command", () => {
  test("nobody: arming takes it, unless it must be asked for", () => {
    const free = authorityView(report(), "bob", NOW);
    expect([free.holder, free.name, free.left_s]).toEqual(["nobody", null, null]);
    expect(withoutAuthority(free)).toBeNull();
    expect(leaseSentence(free)).toMatch(/Arming/);
    const explicit = authorityView(report({ explicit: true }), "bob", NOW);
    expect(withoutAuthority(explicit)).toMatch(/Nobody has the authority/);
  });

  test("before the server has told nobody has it", () => {
    expect(authorityView(undefined, "bob", NOW).holder).toBe("nobody");
  });

  test("its holder commands, the others are told who", () => {
    const mine = authorityView(held, "ada", NOW);
    expect([mine.holder, mine.left_s, mine.left]).toEqual(["mine", 12, 0.4]);
    expect(withoutAuthority(mine)).toBeNull();
    const theirs = authorityView(held, "bob", NOW);
    expect(theirs.holder).toBe("theirs");
    expect(withoutAuthority(theirs)).toMatch(/^ada has the authority/);
    expect(leaseSentence(theirs)).toBe("It lapses 30.0 s after the last word of ada's console.");
  });

  test("a lease that has run out is nobody's, before the server says so", () => {
    const lapsed = authorityView(held, "bob", NOW + 12_001);
    expect([lapsed.holder, lapsed.name, lapsed.asked]).toEqual(["nobody", null, null]);
    expect(withoutAuthority(lapsed)).toBeNull();
  });

  test("who asks is told while it is asked", () => {
    const asked = { ...held, asked_by: "bob", asked_until: "2026-11-23T12:00:05Z" };
    expect(authorityView(asked, "ada", NOW).asked).toEqual({ by: "bob", left_s: 5 });
    expect(authorityView(asked, "ada", NOW + 5001).asked).toBeNull();
  });

  test("it is renewed three times in a lease, and not more often than three times a second", () => {
    expect(renewEvery_ms(30)).toBe(10_000);
    expect(renewEvery_ms(0.5)).toBe(300);
  });
});
