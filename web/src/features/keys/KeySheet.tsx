import { useView } from "../../store/view";
import { Dialog } from "../../ui/Dialog";
import { KEYS } from "./keys";
import "./keys.css";

export function KeySheet() {
  const open = useView((s) => s.keysOpen);
  return open ? <Sheet /> : null;
}

function Sheet() {
  const close = () => useView.setState({ keysOpen: false });
  return (
    <Dialog label="Keys" testId="keys" onClose={close}>
      <header className="section row between">
        <strong>Keys</strong>
        <button type="button" className="button" onClick={close}>
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
    </Dialog>
  );
}
