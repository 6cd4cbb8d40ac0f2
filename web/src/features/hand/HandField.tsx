// A number of a command by hand.

/** A text as a number within bounds, or null. */
export function within(text: string, most: number): number | null {
  const value = Number(text);
  return text.trim() !== "" && Number.isFinite(value) && Math.abs(value) <= most ? value : null;
}

interface FieldProps {
  label: string;
  testId: string;
  value: string;
  /** What is typed cannot be used. */
  bad?: boolean;
  set: (text: string) => void;
}

export function HandField({ label, testId, value, bad = false, set }: FieldProps) {
  return (
    <label className="field">
      {label}
      <input
        type="number"
        step="any"
        className="num"
        data-testid={testId}
        aria-invalid={bad}
        value={value}
        onChange={(event) => set(event.target.value)}
      />
    </label>
  );
}
