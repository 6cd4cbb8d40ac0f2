/** A ring that empties: `left` is the share that remains, 0 to 1. */
export function Ring({ left, label }: { left: number; label: string }) {
  const turn = 2 * Math.PI * 8;
  return (
    <svg width="20" height="20" viewBox="0 0 20 20" role="img" aria-label={label}>
      <circle cx="10" cy="10" r="8" fill="none" stroke="var(--surface-3)" strokeWidth="3" />
      <circle
        cx="10"
        cy="10"
        r="8"
        fill="none"
        stroke="var(--accent)"
        strokeWidth="3"
        strokeDasharray={`${turn * Math.max(0, Math.min(1, left))} ${turn}`}
        transform="rotate(-90 10 10)"
      />
    </svg>
  );
}
