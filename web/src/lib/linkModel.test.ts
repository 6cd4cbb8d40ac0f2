import { expect, test } from "vitest";

import type { LinkChange, LinkCounters, LinkPreset } from "../api/types";
import {
  beginOutage,
  configOf,
  draftOf,
  endOutage,
  isUsable,
  offBalance,
  outageAt,
  outageUntil,
  presetOf,
  usableDraft,
} from "./linkModel";

const NOW = Date.parse("2026-11-23T12:00:00Z");
/** As the server tells a direction with a rate and nothing else. */
const rated = (rate_bps: number, more: object = {}) => ({
  light_times: [],
  jitter: { kind: "none" as const },
  rate_bps,
  mtu_bytes: 1024,
  loss: { kind: "none" as const },
  corruption: 0,
  duplication: 0,
  outages: [],
  in_order: true,
  seed: 0,
  ...more,
});
const MOON: LinkChange = {
  up_delay_s: 1.28,
  down_delay_s: 1.28,
  up: rated(16e3, { mtu_bytes: 256 }),
  down: rated(256e3),
};
const LAB: LinkChange = { up_delay_s: 0, down_delay_s: 0 };
const presets = [
  { name: "lab", title: "", config: LAB },
  { name: "moon", title: "", config: MOON },
] as LinkPreset[];

test("a form that is not touched changes nothing", () => {
  const next = configOf(MOON, draftOf(MOON));
  expect(next).toEqual(MOON);
  expect(configOf(LAB, draftOf(LAB))).toEqual({ ...LAB, up: {}, down: {} });
});

test("what is filled in replaces its part alone", () => {
  const draft = draftOf(MOON);
  expect(draft.up).toEqual({
    delay: "1.28",
    rate: "16",
    jitter: "0",
    loss: "0",
    corruption: "0",
    duplication: "0",
  });
  draft.up = { ...draft.up, rate: "", loss: "2.5", jitter: "0.3", duplication: "1" };
  const { up, down } = configOf(MOON, draft);
  expect(down).toEqual(MOON.down);
  expect(up).not.toHaveProperty("rate_bps");
  expect(up).toMatchObject({
    mtu_bytes: 256,
    loss: { kind: "bernoulli", probability: 0.025 },
    jitter: { kind: "uniform", most_s: 0.3 },
    duplication: 0.01,
  });
});

test("loss in bursts is shown by what it loses in the long run, and kept", () => {
  // In bad for 1 of 4 frames, where half are lost: an eighth.
  const loss = {
    kind: "gilbert_elliott" as const,
    to_bad: 0.1,
    to_good: 0.3,
    loss_good: 0,
    loss_bad: 0.5,
  };
  const bursts = { ...MOON, up: rated(16e3, { loss }) };
  const draft = draftOf(bursts);
  expect(draft.up.loss).toBe("12.5");
  expect(configOf(bursts, draft).up?.loss).toEqual(loss);
});

test("a light time that is set by hand is a fixed one", () => {
  const table = [{ time: "2026-11-23T12:00:00Z", delay_s: 2 }];
  const moving = { ...MOON, up: rated(16e3, { light_times: table }) };
  expect(configOf(moving, draftOf(moving)).up?.light_times).toEqual(table);
  const draft = draftOf(moving);
  draft.up.delay = "3";
  expect(configOf(moving, draft).up).not.toHaveProperty("light_times");
});

test("values beyond their range cannot be used; the rate may be left out", () => {
  for (const [field, text, good] of [
    ["delay", "1800", true],
    ["delay", "1800.1", false],
    ["delay", "-1", false],
    ["delay", "", false],
    ["rate", "", true],
    ["rate", "0", false],
    ["loss", "100", true],
    ["loss", "101", false],
    ["jitter", "x", false],
  ] as const) {
    expect(isUsable(field, text), `${field} ${text}`).toBe(good);
  }
  const draft = draftOf(LAB);
  expect(usableDraft(draft)).toBe(true);
  draft.down.loss = "";
  expect(usableDraft(draft)).toBe(false);
});

test("a link is known by its preset, whatever its outages", () => {
  expect(presetOf(MOON, presets)).toBe("moon");
  expect(presetOf(beginOutage(MOON, NOW, 10, "hold"), presets)).toBe("moon");
  expect(presetOf(beginOutage(LAB, NOW, 10, "lose"), presets)).toBe("lab");
  expect(presetOf({ ...MOON, up_delay_s: 1.3 }, presets)).toBeNull();
  expect(presetOf({ ...LAB, up: rated(1000) }, presets)).toBeNull();
  expect(presetOf({ ...LAB, up: { in_order: false } }, presets)).toBeNull();
});

test("an outage goes both ways, takes the place of those it overlaps, and is ended", () => {
  const later = {
    begin: "2026-11-23T13:00:00Z",
    end: "2026-11-23T14:00:00Z",
    traffic: "lose" as const,
  };
  const soon = {
    begin: "2026-11-23T12:00:20Z",
    end: "2026-11-23T12:00:40Z",
    traffic: "lose" as const,
  };
  const link = { ...MOON, up: rated(16e3, { outages: [soon, later] }) };
  const out = beginOutage(link, NOW, 30, "hold");
  const begun = {
    begin: "2026-11-23T12:00:00.000Z",
    end: "2026-11-23T12:00:30.000Z",
    traffic: "hold",
  };
  expect(out.up?.outages).toEqual([begun, later]);
  expect(out.down?.outages).toEqual([begun]);
  expect([out.up_delay_s, out.up?.rate_bps]).toEqual([1.28, 16e3]);
  expect(outageUntil(out, NOW + 1000)).toBe(NOW + 30_000);
  expect(outageUntil(out, NOW + 30_000)).toBeNull();
  const ended = endOutage(out, NOW + 5000);
  expect([ended.up?.outages, ended.down?.outages]).toEqual([[later], []]);
  expect(outageUntil(ended, NOW + 5000)).toBeNull();
});

test("sent and copied are arrived, dropped or under way", () => {
  const counters = {
    sent: 10,
    duplicated: 2,
    delivered: 8,
    dropped: 3,
    in_flight: 1,
  } as LinkCounters;
  expect(offBalance(counters)).toBe(0);
  expect(offBalance({ ...counters, delivered: 7 })).toBe(1);
});

const clockAt = (clock: string) => Date.parse(`2026-11-27T${clock}Z`);
const oneOutage = {
  begin: "2026-11-27T10:00:00Z",
  end: "2026-11-27T10:01:00.5Z",
  traffic: "hold" as const,
};

test("an outage is in force from its first moment to the one before its end", () => {
  const model = { outages: [oneOutage] };
  expect(outageAt(model, clockAt("09:59:59.999"))).toBeNull();
  expect(outageAt(model, clockAt("10:00:00"))).toBe(oneOutage);
  expect(outageAt(model, clockAt("10:01:00.499"))).toBe(oneOutage);
  expect(outageAt(model, clockAt("10:01:00.5"))).toBeNull();
});

test("a link without a model has none", () => {
  expect(outageAt(null, clockAt("10:00:00"))).toBeNull();
  expect(outageAt({ outages: [] }, clockAt("10:00:00"))).toBeNull();
});
