import { describe, expect, it } from "vitest";

import { dayOfYear, formatClock, formatDayTime, formatSpan, parseTime, formatAge } from "./time";

describe("times", () => {
  it("are read with their decimals", () => {
    // 1 000 000 000 s after the epoch was 2001-09-09T01:46:40Z.
    expect(parseTime("2001-09-09T01:46:40.250000000Z")).toBe(1_000_000_000_250);
    expect(parseTime("2001-09-09T01:46:40Z")).toBe(1_000_000_000_000);
  });

  it.each(["", "yesterday", "2001-09-09T01:46:40+01:00", "2001-09-09 01:46:40Z"])(
    "%j is none",
    (text) => expect(parseTime(text)).toBeNaN(),
  );

  it("day of the year counts leap days", () => {
    expect(dayOfYear(Date.UTC(2026, 0, 1))).toBe(1);
    expect(dayOfYear(Date.UTC(2024, 11, 31, 23, 59, 59))).toBe(366);
    expect(dayOfYear(Date.UTC(2026, 10, 23, 12))).toBe(327);
  });

  it("are shown in UTC, 24 h, with three digits of the day", () => {
    expect(formatDayTime(Date.UTC(2026, 1, 3, 4, 5, 6, 789))).toBe("2026-034T04:05:06.7Z");
    expect(formatClock(Date.UTC(2026, 1, 3, 23, 5, 6))).toBe("23:05:06");
    expect(formatClock(NaN)).toBe("--:--:--");
  });

  it("spans stay short", () => {
    expect([0, 1.26, 99.94, 99.96, 125, 3607].map(formatSpan)).toEqual([
      "0.0 s",
      "1.3 s",
      "99.9 s",
      "1:40",
      "2:05",
      "1:00:07",
    ]);
    expect(formatSpan(-3)).toBe("0.0 s");
    expect(formatSpan(NaN)).toBe("–");
  });
});

describe("ages", () => {
  it("are told in whole units", () => {
    const texts = [0, 0.4, 33.4, 99.6, 150, 5999, 7000, 200_000, NaN].map(formatAge);
    expect(texts).toEqual(["0 s", "0 s", "33 s", "2 min", "3 min", "100 min", "2 h", "2 d", "–"]);
    expect(formatAge(-5)).toBe("0 s");
  });
});
