import { useEffect, useRef } from "react";

import { useView } from "../../store/view";
import { KEYS } from "./keys";
import "./keys.css";

export function KeySheet() {
  const open = useView((s) => s.keysOpen);
  return open ? <Sheet /> : null;
}

function Sheet() {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  return (
    <dialog
      ref={dialog}
      className="import key-sheet"
      aria-label="Keys"
      data-testid="keys"
      onClose={() => useView.setState({ keysOpen: false })}
    >
      <header className="section row between">
        <strong>Keys</strong>
        <button type="button" className="button" onClick={() => dialog.current?.close()}>
          Close
        </button>
      </header>
      <dl className="section keys">
        {KEYS.map(([keys, what]) => (
          <div key={what} className="key-row">
            <dt>
              {keys.map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{what}</dd>
          </div>
        ))}
      </dl>
    </dialog>
  );
}
