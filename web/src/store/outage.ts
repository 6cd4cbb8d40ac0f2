// What is known beforehand of the link's silence: outages as they were set.

import type { DirectionModel, Outage } from "../api/types";
import { parseTime } from "../lib/time";

/** The outage of a direction that is in force, or null. */
export function outageAt(
  model: Pick<DirectionModel, "outages"> | null | undefined,
  now_ms: number,
): Outage | null {
  const inForce = (outage: Outage) =>
    parseTime(outage.begin) <= now_ms && now_ms < parseTime(outage.end);
  return model?.outages?.find(inForce) ?? null;
}
