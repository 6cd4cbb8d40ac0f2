// The margin of stability as a small dial: 0 in red, what is needed as a tick.

import { metres } from "../../lib/format";
import { StatusMark } from "../../ui/StatusMark";

const FULL_M = 1;
const [CX, CY, R] = [60, 54, 42];

function at(share: number): string {
  const angle = Math.PI * (1 - share);
  return `${(CX + R * Math.cos(angle)).toFixed(2)} ${(CY - R * Math.sin(angle)).toFixed(2)}`;
}

function arc(from: number, to: number): string {
  return `M${at(from)}A${R} ${R} 0 0 1 ${at(to)}`;
}

interface Props {
  margin_m: number | null;
  needed_m: number;
  /** What decides, in a few words. */
  children?: React.ReactNode;
}

export function MarginDial({ margin_m, needed_m, children }: Props) {
  const share = Math.min(1, Math.max(0, (margin_m ?? 0) / FULL_M));
  const need = Math.min(1, needed_m / FULL_M);
  const status =
    margin_m === null
      ? "off"
      : margin_m < 0
        ? "critical"
        : margin_m < needed_m
          ? "serious"
          : "normal";
  const angle = Math.PI * (1 - need);
  return (
    <div className="row margin-dial" data-testid="margin">
      <svg width="96" height="52" viewBox="0 0 120 64" aria-hidden>
        <path d={arc(0, 1)} fill="none" stroke="var(--surface-3)" strokeWidth="8" />
        {share > 0.005 && (
          <path
            d={arc(0, share)}
            fill="none"
            strokeWidth="8"
            stroke={status === "normal" ? "var(--text-2)" : `var(--${status})`}
          />
        )}
        <path
          d={`M${CX + 34 * Math.cos(angle)} ${CY - 34 * Math.sin(angle)}L${CX + 50 * Math.cos(angle)} ${CY - 50 * Math.sin(angle)}`}
          stroke="var(--text)"
          strokeWidth="2"
        />
      </svg>
      <div>
        <div className="row">
          <StatusMark status={status} label={status} />
          <strong className="num margin-figure">{metres(margin_m)}</strong>
        </div>
        <div className="quiet small" title="Least margin that the margin rule asks for">
          needs {metres(needed_m)}
        </div>
        {children && <div className="quiet small">{children}</div>}
      </div>
    </div>
  );
}
