// One of a few, side by side: radio buttons that look like one strip.

interface Props<T extends string> {
  /** Unique on the page. */
  name: string;
  /** Id of what names the choice, or the name itself. */
  labelledBy?: string;
  label?: string;
  choices: [value: T, label: string, title?: string][];
  value: T;
  set: (value: T) => void;
  /** Prefix of the test ids. */
  testId: string;
  /** In one row however many there are. */
  inline?: boolean;
}

export function Segments<T extends string>(props: Props<T>) {
  const { name, label, labelledBy, choices, value, set, testId, inline = false } = props;
  return (
    <div
      className={choices.length > 3 && !inline ? "segments grid" : "segments"}
      role="radiogroup"
      aria-label={label}
      aria-labelledby={labelledBy}
    >
      {choices.map(([choice, text, title]) => (
        <label key={choice} className="segment" title={title}>
          <input
            type="radio"
            name={name}
            value={choice}
            data-testid={`${testId}-${choice}`}
            checked={value === choice}
            onChange={() => set(choice)}
          />
          <span>{text}</span>
        </label>
      ))}
    </div>
  );
}
