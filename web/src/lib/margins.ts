// All margins of a stance as rows of one table: value, status, and what decides.

import type { StabilityDerived } from "../api/types";
import type { Status } from "../store/causes";
import { legLabel, metres, percent, readable, signless } from "./format";
import { feetLabel, feetOf, type Region, type RegionKey, regionOf } from "./regions";

export interface MarginRow {
  key: string;
  name: string;
  /** What the row means, for its tooltip. */
  about: string;
  value: string;
  /** A second figure of the same thing. */
  beside: string;
  status: Status;
  /** The status in words. */
  says: string;
  /** Edge, legs or joint that decides. */
  critical: string;
  /** Why there is no figure. */
  why: string | null;
}

type Judged = Pick<MarginRow, "status" | "says">;

const UNKNOWN: Judged = { status: "off", says: "not known" };
const NO_LIMIT: Judged = { status: "off", says: "nothing is asked of it" };

/** A joint this near to its limit is worth a look. */
const TORQUE_CAUTION = 0.8;

interface Rule {
  /** Below this a status is shown (m). */
  needed_m: number;
  below: Status;
  /** Below zero; also where there is no such region. */
  outside: Status;
}

function judge(margin_m: number, { needed_m, below, outside }: Rule): Judged {
  if (margin_m < 0) return { status: outside, says: "outside" };
  if (margin_m < needed_m) return { status: below, says: `below ${metres(needed_m)}` };
  return { status: "normal", says: "holds" };
}

interface Named {
  name: string;
  about: string;
}

const REGION_ROWS: Record<RegionKey, Named> = {
  regular: { name: "Regular", about: "To the nearest edge between standing feet" },
  conservative: { name: "Conservative", about: "What is left should any one foot slip" },
  friction: { name: "Friction", about: "Where friction of the contacts holds the rover" },
  frictionLoss: {
    name: "Friction, any loss",
    about: "Where friction holds it should any one foot be lost",
  },
  torque: {
    name: "Torque region",
    about: "Where friction and joint torques hold it, at the present joint angles",
  },
};

export const regionName = (key: RegionKey): string => REGION_ROWS[key].name;
export const regionAbout = (key: RegionKey): string => REGION_ROWS[key].about;

/** The margin, or that there is none, in a word. */
export function shortly({ kind, polygon }: Region): string {
  if (kind === "area") return metres(polygon?.margin_m);
  return kind === "unknown" ? "–" : kind === "point" ? "a point" : "none";
}

function regionRow(region: Region, rule: Rule, n_standing: number): MarginRow {
  const { name, about } = REGION_ROWS[region.key];
  const row = { key: region.key, name, about, beside: "", critical: "", why: null };
  if (region.kind === "unknown") return { ...row, value: "–", ...UNKNOWN };
  const { polygon } = region;
  if (region.kind === "empty" || !polygon) {
    return { ...row, value: "none", status: rule.outside, says: "none", why: region.whyEmpty };
  }
  const judged = judge(polygon.margin_m, rule);
  if (region.kind === "point") {
    return { ...row, value: metres(polygon.margin_m), beside: "a point", ...judged };
  }
  const critical = feetLabel(feetOf(polygon.critical), n_standing);
  const beside = region.capped ? "capped" : "";
  const why = region.capped
    ? "It reaches so far only because feet push against each other with 100 times the weight."
    : null;
  return { ...row, value: metres(polygon.margin_m), beside, critical, why, ...judged };
}

function torqueRow(
  named: Named & { key: string },
  ratio: number | null | undefined,
  joint: string | null | undefined,
  absent: string | null,
): MarginRow {
  const row = { ...named, beside: "", critical: joint ? readable(joint) : "" };
  if (ratio == null) return { ...row, value: "–", ...UNKNOWN, why: absent };
  const judged: Judged =
    ratio > 1
      ? { status: "critical", says: "over its limit" }
      : ratio > TORQUE_CAUTION
        ? { status: "caution", says: `above ${percent(TORQUE_CAUTION)}` }
        : { status: "normal", says: "within its limit" };
  return { ...row, value: percent(ratio), why: null, ...judged };
}

function slipRow(forces: StabilityDerived["forces"]): MarginRow {
  const row = {
    key: "slip",
    name: "Friction to spare",
    about: "How much the friction of all contacts may fall before the rover slips",
    critical: "",
    why: null,
  };
  if (!forces) return { ...row, value: "–", beside: "", ...UNKNOWN };
  const beside = `of ${forces.friction_coefficient.toFixed(2)}`;
  const { slip_margin } = forces;
  if (slip_margin == null) {
    const why = "No friction would hold this stance";
    return { ...row, value: "none", beside, status: "critical", says: "slips", why };
  }
  const judged: Judged =
    slip_margin < 0
      ? { status: "critical", says: "slips" }
      : { status: "normal", says: "does not slip" };
  return { ...row, value: signless(slip_margin, 2), beside, ...judged };
}

function energyRow(forces: StabilityDerived["forces"]): MarginRow {
  const { energy_margin_m = null, energy_margin_j = null, energy_edge } = forces ?? {};
  const why = forces && energy_margin_m === null ? "There is no support polygon" : null;
  const judged: Judged =
    energy_margin_m === null
      ? UNKNOWN
      : energy_margin_m <= 0
        ? { status: "critical", says: "tips by itself" }
        : NO_LIMIT;
  return {
    key: "energy",
    name: "Energy to tip",
    about: "By how much the center of mass must rise to tip over the weakest edge, and the work",
    value: metres(energy_margin_m),
    beside: energy_margin_j === null ? "" : joules(energy_margin_j),
    critical: feetLabel(energy_edge ?? []),
    why,
    ...judged,
  };
}

function settlementRow(stability: StabilityDerived, settlement_m: number): MarginRow {
  const { settlement_margin_m: margin_m = null, settlement_leg } = stability;
  return {
    key: "settlement",
    name: "After settling",
    about: `Should the worst foot settle by ${metres(settlement_m)}`,
    value: metres(margin_m),
    beside: "",
    critical: settlement_leg ? legLabel(settlement_leg) : "",
    why: null,
    ...(margin_m === null
      ? UNKNOWN
      : judge(margin_m, { needed_m: 0, below: "caution", outside: "caution" })),
  };
}

export function joules(value: number): string {
  if (!Number.isFinite(value)) return "–";
  return Math.abs(value) < 9950 ? `${signless(value, 0)} J` : `${signless(value / 1000, 1)} kJ`;
}

export interface Asked {
  /** Least regular margin that the margin rule asks for (m). */
  margin_m: number;
  settlement_m: number;
}

export interface MarginTable {
  regions: MarginRow[];
  others: MarginRow[];
  torques: MarginRow[];
  /** Null where nobody said. */
  torqueSafe: boolean | null;
}

export function marginTable(stability: StabilityDerived, asked: Asked): MarginTable {
  const forces = stability.forces ?? null;
  const n_standing = Object.keys(forces?.contact_forces_n ?? {}).length || Infinity;
  const held: Rule = { needed_m: asked.margin_m, below: "serious", outside: "critical" };
  const lost: Rule = { needed_m: 0, below: "caution", outside: "caution" };
  const row = (key: RegionKey, rule: Rule) => regionRow(regionOf(stability, key), rule, n_standing);
  return {
    regions: [
      row("regular", held),
      settlementRow(stability, asked.settlement_m),
      row("conservative", lost),
      row("friction", held),
      row("frictionLoss", lost),
      row("torque", { needed_m: 0, below: "serious", outside: "serious" }),
    ],
    others: [energyRow(forces), slipRow(forces)],
    torques: [
      torqueRow(
        {
          key: "leastTorque",
          name: "Torque, best",
          about: "Largest torque of its limit, with the contact forces that spare the joints best",
        },
        forces?.least_torque_ratio,
        forces?.least_torque_joint,
        forces ? "No forces hold this stance" : null,
      ),
      torqueRow(
        {
          key: "loadTorque",
          name: "Torque, compliant",
          about: "Largest torque of its limit, with the loads that springy legs may carry",
        },
        forces?.load_torque_ratio,
        forces?.load_torque_joint,
        forces ? "It tips" : null,
      ),
    ],
    torqueSafe: forces?.torque_safe ?? null,
  };
}
