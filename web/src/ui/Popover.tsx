// A small panel under its button; Escape or a press outside closes it.

import { useEffect, useRef, useState } from "react";

interface Props {
  /** What the button shows. */
  label: React.ReactNode;
  title: string;
  /** Side of the button that the panel lines up with. */
  side?: "left" | "right";
  className?: string;
  testId?: string;
  children: (close: () => void) => React.ReactNode;
}

export function Popover({ label, title, side = "left", className = "", testId, children }: Props) {
  const [open, setOpen] = useState(false);
  const root = useRef<HTMLDivElement>(null);
  const button = useRef<HTMLButtonElement>(null);

  useEffect(() => {
    if (!open) return;
    const onPress = (event: PointerEvent) => {
      if (!root.current?.contains(event.target as Node)) setOpen(false);
    };
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== "Escape") return;
      setOpen(false);
      button.current?.focus();
    };
    document.addEventListener("pointerdown", onPress);
    document.addEventListener("keydown", onKey);
    return () => {
      document.removeEventListener("pointerdown", onPress);
      document.removeEventListener("keydown", onKey);
    };
  }, [open]);

  return (
    <div className="anchor" ref={root}>
      <button
        ref={button}
        type="button"
        className={`chip ${className}`}
        title={title}
        aria-expanded={open}
        aria-haspopup="dialog"
        data-testid={testId}
        onClick={() => setOpen(!open)}
      >
        {label}
      </button>
      {open && (
        <div className="popover" role="dialog" aria-label={title} style={{ [side]: 0 }}>
          {children(() => setOpen(false))}
        </div>
      )}
    </div>
  );
}
