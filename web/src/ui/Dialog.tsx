// A dialog over everything but the global bar: E-stop stays within reach of the pointer.

import { useEffect, useRef } from "react";

interface Props {
  label: string;
  testId: string;
  className?: string;
  onClose: () => void;
  children: React.ReactNode;
}

export function Dialog({ label, testId, className = "", onClose, children }: Props) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    const before = document.activeElement;
    dialog.current?.show();
    return () => {
      if (before instanceof HTMLElement) before.focus({ preventScroll: true });
    };
  }, []);
  // On the whole document: a button that was pressed and then disabled leaves the focus nowhere.
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.key === "Escape") onClose();
    };
    document.addEventListener("keydown", onKey);
    return () => document.removeEventListener("keydown", onKey);
  }, [onClose]);
  return (
    <div
      className="dialog-back"
      onPointerDown={(event) => event.target === event.currentTarget && onClose()}
    >
      <dialog
        ref={dialog}
        className={`dialog ${className}`}
        aria-label={label}
        data-testid={testId}
      >
        {children}
      </dialog>
    </div>
  );
}
