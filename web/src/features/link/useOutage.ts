import { outageUntil } from "../../lib/linkModel";
import { useChannels } from "../../store/console";
import { useShownNow } from "../../store/now";

/** Seconds until the outage under way ends; null without one. */
export function useOutage(): number | null {
  const now = useShownNow();
  const config = useChannels((c) => c.link?.message.config ?? null);
  const until = config && outageUntil(config, now);
  return until === null ? null : (until - now) / 1000;
}
