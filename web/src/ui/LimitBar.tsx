/** A value against its limit: quiet below `inner`, then caution, then critical above 1. */
export function LimitBar({
  ratio,
  inner = 0.8,
  label,
}: {
  ratio: number;
  inner?: number;
  label: string;
}) {
  const share = Math.min(1, Math.abs(ratio));
  const color =
    Math.abs(ratio) > 1
      ? "var(--critical)"
      : Math.abs(ratio) > inner
        ? "var(--caution)"
        : "var(--text-2)";
  return (
    <span className="limit-bar" role="img" aria-label={label} title={label}>
      <span style={{ width: `${share * 100}%`, background: color }} />
      <i style={{ left: `${inner * 100}%` }} />
    </span>
  );
}
