// The link: up or down and its light time in the bar; below it its model, outages for trials and counters.

import { ArrowDown, ArrowUp } from "lucide-react";

import { formatSpan } from "../../lib/time";
import { carrierDown } from "../../store/carrier";
import { useChannels, useConsole } from "../../store/console";
import { Popover } from "../../ui/Popover";
import { StatusMark } from "../../ui/StatusMark";
import { LinkFigures } from "./LinkFigures";
import { LinkForm } from "./LinkForm";
import { Outage } from "./Outage";
import { useOutage } from "./useOutage";
import "./link.css";

export function LinkMenu() {
  const connection = useConsole((s) => s.connection);
  const link = useChannels((c) => c.link?.message ?? null);
  const down = useChannels((c) => carrierDown(c));
  const outage_s = useOutage();
  const bad = down || connection === "lost";
  const status = bad ? "critical" : connection !== "open" ? "off" : outage_s ? "serious" : "normal";
  const label = (
    <>
      <StatusMark status={status} />
      <span>
        {connection === "lost"
          ? "No link"
          : connection !== "open"
            ? "Connecting"
            : down
              ? "No rover"
              : outage_s
                ? "Outage"
                : "Link"}
      </span>
      {outage_s !== null && <span className="num quiet">{formatSpan(outage_s)}</span>}
      {link && (
        <span className="num quiet row link-delays" data-testid="delays">
          <ArrowUp size={12} aria-label="up" />
          {formatSpan(link.config.up_delay_s)}
          <ArrowDown size={12} aria-label="down" />
          {formatSpan(link.config.down_delay_s)}
        </span>
      )}
    </>
  );
  return (
    <Popover label={label} title="Link and its delays" testId="link">
      {() =>
        link ? (
          <div className="link-menu">
            <LinkForm config={link.config} />
            <Outage config={link.config} />
            <LinkFigures link={link} />
          </div>
        ) : (
          <p className="empty">The server has not told of the link yet.</p>
        )
      }
    </Popover>
  );
}
