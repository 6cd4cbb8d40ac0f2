// The words and figures of the posture adviser and of the rehearsal.

import type {
  PostureAccident,
  PostureAccidents,
  PostureAdvice,
  PostureAftermath,
  PostureBarrier,
  PostureMargins,
  PostureProposal,
  PostureRequest,
  StabilityPreference,
} from "../api/types";
import type { Status } from "../store/causes";
import { capital, degrees, legLabel, metres, percent, readable } from "./format";

/** What is wished for, and what may change. */
export interface PostureWish {
  /** Wanted margin without the leg (m); null is what the rule asks for. */
  regular_m: number | null;
  /** Wanted margin should one more leg be lost (m); null where that is not asked for. */
  conservative_m: number | null;
  chassis: "whole" | "level";
  fold: boolean;
  replace: boolean;
}

export const USUAL_WISH: PostureWish = {
  regular_m: null,
  conservative_m: null,
  chassis: "whole",
  fold: true,
  replace: true,
};

/** How plans are to be made, as far as it concerns a posture: the step after it is made so too. */
export interface PostureOptions {
  stability: StabilityPreference;
  drive_hold: boolean;
  seed: number;
}

/** The conservative margin that is asked for, by the wish or by the preference of plans (m). */
export function conservativeWish(
  wish: Pick<PostureWish, "conservative_m">,
  { stability }: Pick<PostureOptions, "stability">,
): number | null {
  return wish.conservative_m ?? (stability === "conservative" ? 0 : null);
}

/** The margin within what friction holds that is asked for: the rule's, where plans go by friction (m). */
export function frictionWish({ stability }: Pick<PostureOptions, "stability">): number | null {
  return stability === "friction" ? 0 : null;
}

/** The request; what is as usual is left to the server. */
export function postureRequest(
  leg: string,
  wish: PostureWish,
  options: PostureOptions,
): PostureRequest {
  const { regular_m, chassis, fold, replace } = wish;
  const conservative_m = conservativeWish(wish, options);
  const friction_m = frictionWish(options);
  return {
    advice: {
      leg,
      ...(regular_m !== null && { regular_m }),
      ...(conservative_m !== null && { conservative_m }),
      ...(friction_m !== null && { friction_m }),
      ...(chassis !== USUAL_WISH.chassis && { chassis }),
      ...(!fold && { fold }),
      ...(!replace && { replace }),
      ...(options.drive_hold && { drive_hold: true }),
    },
    ...(options.seed !== 1 && { seed: options.seed }),
  };
}

/** What can be gone to: the proposals; where the wish is not met, the best posture if it moves at all. */
export function offeredBy({ proposals, best }: PostureAdvice): PostureProposal[] {
  if (proposals.length > 0) return proposals;
  return best && best.posture.commands.length > 0 ? [best.posture] : [];
}

type Changed = Pick<PostureProposal, "change" | "replaced_leg">;

/** What moves, in words. */
export function changeName({ change, replaced_leg }: Changed, leg: string): string {
  switch (change) {
    case "chassis":
      return "Move the chassis";
    case "fold":
      return `Lift and fold ${legLabel(leg)}`;
    default:
      return replaced_leg ? `Put ${legLabel(replaced_leg)} elsewhere` : "Put a foot elsewhere";
  }
}

/** What it costs, shortest first: way, turn, time. */
export function costWords({ cost }: Pick<PostureProposal, "cost">): string {
  const parts = [
    cost.chassis_m > 5e-4 ? `body ${centimetres(cost.chassis_m)}` : "",
    cost.turn_rad > 1e-3 ? degrees(cost.turn_rad) : "",
    cost.legs_rad > 1e-3 ? `leg ${degrees(cost.legs_rad, 0)}` : "",
  ];
  return parts.filter(Boolean).join(" · ");
}

const centimetres = (m: number) => (m < 0.995 ? `${(100 * m).toFixed(0)} cm` : metres(m));

export interface MarginPair {
  key: string;
  name: string;
  before: string;
  after: string;
  /** Does it get more? Null where it stays or nobody knows. */
  more: boolean | null;
}

/** Margins without the leg, before and after. */
export function marginPairs(before: PostureMargins, after: PostureMargins): MarginPair[] {
  const pair = (
    key: string,
    name: string,
    a: number | null | undefined,
    b: number | null | undefined,
    show: (v: number | null | undefined) => string,
    lessIsMore = false,
  ): MarginPair => {
    const change = a == null || b == null ? 0 : lessIsMore ? a - b : b - a;
    return {
      key,
      name,
      before: show(a),
      after: show(b),
      more: Math.abs(change) < 0.005 ? null : change > 0,
    };
  };
  const m = (v: number | null | undefined) => (v == null ? "none" : metres(v));
  const { friction_m } = before;
  // Told only where it was wished for: without a region both are absent, and the row would say nothing.
  const friction = friction_m != null || after.friction_m != null;
  return [
    pair("regular", "Regular", before.regular_m, after.regular_m, m),
    pair("settlement", "After settling", before.settlement_m, after.settlement_m, m),
    pair("conservative", "Conservative", before.conservative_m, after.conservative_m, m),
    ...(friction ? [pair("friction", "Friction", friction_m, after.friction_m, m)] : []),
    pair("torque", "Torque", before.torque_ratio, after.torque_ratio, percent, true),
  ];
}

const BARRIERS: Record<string, string> = {
  reach: "A leg is stretched to its reach",
  joint_limits: "A joint is at its limit",
  singularity: "A leg is at a straight wrist or knee",
  clearance: "Something is in the way",
  torque: "A joint is at its torque limit",
  stability: "The margin would be too small on the way",
  closure: "The wheels would not keep their places",
  check: "The final check refuses it",
  region: "These feet allow no more",
  search: "The search found nothing better",
};

/** What stands in the way of more: in short, the missing amount, the server's sentence. */
export function barrierWords({ name, missing, unit, detail }: PostureBarrier) {
  const figure =
    missing == null || missing <= 0
      ? null
      : unit === "rad"
        ? degrees(missing)
        : unit === "m"
          ? metres(missing)
          : percent(missing);
  return {
    short: BARRIERS[name] ?? capital(readable(name.replaceAll("_", " "))),
    missing: figure,
    detail: detail ? `${capital(readable(detail))}` : null,
  };
}

export interface WithoutLeg {
  status: Status;
  says: string;
}

export interface RuleAsked {
  /** Least regular margin (m). */
  needed_m: number;
  /** Must one more loss be survived too? */
  conservative: boolean;
  /** Must friction hold with the same margin? */
  friction: boolean;
}

/** Whether the margin rule holds with the leg up, and if not in what it fails. */
export function withoutLeg(
  { outcome, before }: Pick<PostureAdvice, "outcome" | "before">,
  rule: RuleAsked,
): WithoutLeg {
  if (outcome === "already_met") {
    return { status: "normal", says: `${metres(before.regular_m)} margin without it` };
  }
  return { status: "caution", says: `${failing(before, rule)} without it` };
}

function failing(before: PostureMargins, { needed_m, conservative, friction }: RuleAsked): string {
  const { regular_m, settlement_m, conservative_m, friction_m, torque_ratio } = before;
  if (regular_m == null) return "no margin";
  if (regular_m < needed_m) return `${metres(needed_m - regular_m)} short`;
  if ((settlement_m ?? 0) < 0) return "tips on settling";
  if (conservative && (conservative_m ?? -1) < 0) return "a loss tips it";
  if (friction && friction_m == null) return "friction does not hold";
  if (friction && (friction_m ?? 0) < needed_m) {
    return `${metres(needed_m - (friction_m ?? 0))} of friction margin short`;
  }
  return (torque_ratio ?? 0) > 1 ? "a joint overloaded" : "rule not met";
}

export interface AftermathCell {
  margin: string;
  status: Status;
  /** What happens, and whether there is a way back. */
  says: string;
}

/** One accident as a cell of the table. */
export function aftermathCell({
  margin_m,
  tips_over,
  rocks,
  way_back,
}: PostureAftermath): AftermathCell {
  const margin = margin_m == null ? "none" : metres(margin_m);
  const begins = rocks ? "rocks onto it; " : "";
  if (tips_over) return { margin, status: "critical", says: `${begins}tips over` };
  switch (way_back.outcome) {
    case "not_needed":
      return { margin, status: "normal", says: `${begins}safe as it stands` };
    case "found":
      return { margin, status: "caution", says: `${begins}a body shift leads back` };
    default:
      return { margin, status: "serious", says: `${begins}no way back found` };
  }
}

export interface WayBack {
  accident: PostureAccident;
  end: NonNullable<PostureAftermath["way_back"]["end"]>;
  /** What it is the way back from, and what it gives. */
  says: string;
}

/** The ways back that were found, in the order of the legs. */
export function waysBack(legs: PostureAccidents[]): WayBack[] {
  return legs.flatMap(({ leg, lost, settled }) => {
    const of = (kind: PostureAccident["kind"], { way_back, margin_m }: PostureAftermath) => {
      const { outcome, end, margins } = way_back;
      if (outcome !== "found" || !end) return [];
      const what = kind === "lost" ? "lost" : "settles";
      const gives = `${metres(margin_m).replace(" m", "")} → ${metres(margins?.regular_m)}`;
      return [
        { accident: { leg, kind }, end, says: `${capital(legLabel(leg))} ${what}: ${gives}` },
      ];
    };
    return [...of("lost", lost), ...of("settled", settled)];
  });
}
