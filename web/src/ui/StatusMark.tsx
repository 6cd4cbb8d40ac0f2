// A status as colour and shape, always both.

import type { Status } from "../store/causes";

const SHAPES: Record<Status, React.ReactNode> = {
  critical: <path d="M1 2h12L7 13z" fill="var(--critical)" />,
  serious: <path d="M7 .5L13.5 7 7 13.5.5 7z" fill="var(--serious)" />,
  caution: <rect x="1.5" y="1.5" width="11" height="11" fill="var(--caution)" />,
  normal: <circle cx="7" cy="7" r="5.5" fill="var(--normal)" />,
  standby: <circle cx="7" cy="7" r="4.5" fill="none" stroke="var(--standby)" strokeWidth="2.5" />,
  off: <circle cx="7" cy="7" r="3" fill="var(--off)" />,
};

export function StatusMark({ status, label }: { status: Status; label?: string }) {
  return (
    <svg
      width="12"
      height="12"
      viewBox="0 0 14 14"
      className="status-mark"
      role={label ? "img" : undefined}
      aria-label={label}
      aria-hidden={label ? undefined : true}
    >
      {SHAPES[status]}
    </svg>
  );
}
