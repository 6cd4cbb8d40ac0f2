// A number to be filled in. What cannot be used stays in the field, marked, and the value in force stays.

import { useState } from "react";

interface Props {
  label: React.ReactNode;
  title: string;
  testId: string;
  /** The number that is in force; null is none. */
  value: number | null;
  /** Shown where nothing is filled in. */
  usual: string;
  step: number;
  max: number;
  whole?: boolean;
  disabled?: boolean;
  set: (value: number | null) => void;
}

export function NumberField(props: Props) {
  const { label, title, testId, usual, value, step, max, whole, disabled = false, set } = props;
  const shown = value === null ? "" : String(value);
  const [draft, setDraft] = useState<{ text: string; of: number | null } | null>(null);
  // A draft belongs to the value it made: a reset ends it.
  const text = draft && draft.of === value ? draft.text : shown;
  const usable = (t: string) => {
    const number = Number(t);
    return t === "" || (number >= 0 && number <= max && (!whole || Number.isInteger(number)));
  };
  return (
    <label className="field" title={title}>
      {label}
      <input
        type="number"
        className="num"
        data-testid={testId}
        min={0}
        max={max}
        step={step}
        placeholder={usual}
        disabled={disabled}
        aria-invalid={!usable(text)}
        value={text}
        onChange={(event) => {
          const typed = event.target.value;
          const next = typed === "" ? null : Number(typed);
          if (usable(typed)) set(next);
          setDraft({ text: typed, of: usable(typed) ? next : value });
        }}
        onBlur={() => setDraft(null)}
      />
    </label>
  );
}
