// The model of the link as a form, its presets, outages for trials, and whether its counters add up.

import type { DirectionModel, LinkChange, LinkCounters, LinkPreset } from "../api/types";
import { parseTime, toRfc3339 } from "./time";

export type Direction = "up" | "down";
export const DIRECTIONS: Direction[] = ["up", "down"];

type Model = Partial<DirectionModel>;
type Outage = DirectionModel["outages"][number];
export type Traffic = Outage["traffic"];

/** Fields of the form, by what they are called, with the most that is taken and its unit. */
export const LINK_FIELDS = [
  ["delay", "Light time", "s", 1800],
  ["rate", "Rate", "kbit/s", 1e9],
  ["jitter", "Jitter up to", "s", 60],
  ["loss", "Lost", "%", 100],
  ["corruption", "Damaged", "%", 100],
  ["duplication", "Copied", "%", 100],
] as const;

export type LinkField = (typeof LINK_FIELDS)[number][0];
export type LinkDraft = Record<Direction, Record<LinkField, string>>;

const delayOf = (config: LinkChange, direction: Direction) =>
  direction === "up" ? config.up_delay_s : config.down_delay_s;

/** Percent with up to six digits, as they would be typed. */
const percent = (share: number) => String(Number((100 * share).toPrecision(6)));

function lossOf(model: Model | null | undefined): number {
  const loss = model?.loss;
  if (loss?.kind === "bernoulli") return loss.probability;
  if (loss?.kind !== "gilbert_elliott") return 0;
  // In the long run, by the share of time in the bad state.
  const turns = loss.to_bad + loss.to_good;
  const bad = turns > 0 ? loss.to_bad / turns : 0;
  return bad * loss.loss_bad + (1 - bad) * loss.loss_good;
}

export function draftOf(config: LinkChange): LinkDraft {
  const of = (direction: Direction) => {
    const model = config[direction];
    const jitter = model?.jitter;
    return {
      delay: String(delayOf(config, direction)),
      rate: model?.rate_bps == null ? "" : String(model.rate_bps / 1000),
      jitter: String(jitter && jitter.kind !== "none" ? jitter.most_s : 0),
      loss: percent(lossOf(model)),
      corruption: percent(model?.corruption ?? 0),
      duplication: percent(model?.duplication ?? 0),
    };
  };
  return { up: of("up"), down: of("down") };
}

/** Can a field be used as it is? The rate may be left out. */
export function isUsable(field: LinkField, text: string): boolean {
  const most = LINK_FIELDS.find(([name]) => name === field)![3];
  if (text.trim() === "") return field === "rate";
  const value = Number(text);
  return Number.isFinite(value) && value >= (field === "rate" ? 0.001 : 0) && value <= most;
}

export const usableDraft = (draft: LinkDraft) =>
  DIRECTIONS.every((d) => LINK_FIELDS.every(([field]) => isUsable(field, draft[d][field])));

/** `base` with what the form changes of it; all else of its model stays. */
export function configOf(base: LinkChange, draft: LinkDraft): LinkChange {
  const before = draftOf(base);
  const model = (direction: Direction): Model => {
    const next: Model = { ...(base[direction] ?? {}) };
    const changed = (field: LinkField) => draft[direction][field] !== before[direction][field];
    const number = (field: LinkField) => Number(draft[direction][field]);
    if (changed("rate")) {
      if (draft[direction].rate.trim() === "") delete next.rate_bps;
      else next.rate_bps = number("rate") * 1000;
    }
    if (changed("jitter")) {
      const most_s = number("jitter");
      next.jitter = most_s > 0 ? { kind: "uniform", most_s } : { kind: "none" };
    }
    if (changed("loss")) {
      const probability = number("loss") / 100;
      next.loss = probability > 0 ? { kind: "bernoulli", probability } : { kind: "none" };
    }
    if (changed("corruption")) next.corruption = number("corruption") / 100;
    if (changed("duplication")) next.duplication = number("duplication") / 100;
    // A light time that is set by hand is a fixed one.
    if (changed("delay")) delete next.light_times;
    return next;
  };
  return {
    up_delay_s: Number(draft.up.delay),
    down_delay_s: Number(draft.down.delay),
    up: model("up"),
    down: model("down"),
  };
}

/** The preset that a link is; its outages apart. */
export function presetOf(config: LinkChange, presets: readonly LinkPreset[]): string | null {
  const text = (of: LinkChange) => {
    const bare = (direction: Direction) => {
      const model = { ...(of[direction] ?? {}), outages: [] };
      return Object.entries(model).sort(([a], [b]) => (a < b ? -1 : 1));
    };
    return JSON.stringify([of.up_delay_s, of.down_delay_s, bare("up"), bare("down")]);
  };
  const plain = (of: LinkChange) =>
    isPlain(of) ? JSON.stringify([of.up_delay_s, of.down_delay_s]) : text(of);
  return presets.find((preset) => plain(preset.config) === plain(config))?.name ?? null;
}

/** Nothing but delay; its outages apart. */
function isPlain(config: LinkChange): boolean {
  return DIRECTIONS.every((direction) => {
    const model = config[direction];
    if (!model) return true;
    return (
      model.rate_bps == null &&
      (model.jitter ?? { kind: "none" }).kind === "none" &&
      (model.loss ?? { kind: "none" }).kind === "none" &&
      !model.corruption &&
      !model.duplication &&
      !model.light_times?.length &&
      model.in_order !== false
    );
  });
}

/** Both directions with what becomes of their outages. */
function withOutages(config: LinkChange, change: (outages: Outage[]) => Outage[]): LinkChange {
  const model = (direction: Direction): Model => {
    const present = config[direction] ?? {};
    return { ...present, outages: change(present.outages ?? []) };
  };
  return { ...config, up: model("up"), down: model("down") };
}

/** An outage both ways from now on for some seconds; what it overlaps gives way. */
export function beginOutage(
  config: LinkChange,
  now_ms: number,
  seconds: number,
  traffic: Traffic,
): LinkChange {
  const [begin_ms, end_ms] = [now_ms, now_ms + seconds * 1000];
  const outage = { begin: toRfc3339(begin_ms), end: toRfc3339(end_ms), traffic };
  return withOutages(config, (outages) => [
    outage,
    ...outages.filter((o) => parseTime(o.begin) >= end_ms),
  ]);
}

/** Ends what is under way now; outages to come stay. */
export function endOutage(config: LinkChange, now_ms: number): LinkChange {
  return withOutages(config, (outages) => outages.filter((o) => parseTime(o.begin) > now_ms));
}

const inForce = (outage: Outage, now_ms: number) =>
  parseTime(outage.begin) <= now_ms && now_ms < parseTime(outage.end);

/** The outage of a direction that is in force, or null. */
export function outageAt(
  model: Pick<DirectionModel, "outages"> | null | undefined,
  now_ms: number,
): Outage | null {
  return model?.outages?.find((outage) => inForce(outage, now_ms)) ?? null;
}

/** End (ms) of the outage under way in either direction; null without one. */
export function outageUntil(config: LinkChange, now_ms: number): number | null {
  const ends = DIRECTIONS.flatMap((direction) => config[direction]?.outages ?? [])
    .filter((o) => inForce(o, now_ms))
    .map((o) => parseTime(o.end));
  return ends.length === 0 ? null : Math.max(...ends);
}

/** By how many messages the counters are off; zero always, or the link has a fault. */
export function offBalance(c: LinkCounters): number {
  return c.sent + (c.duplicated ?? 0) - c.delivered - c.dropped - c.in_flight;
}
