// A new map: from a file of the server's folder, from an uploaded one, or generated.

import { useState } from "react";

import { api, ApiError, sentenceOf } from "../../api/client";
import type { JobReport } from "../../api/types";
import { capital } from "../../lib/format";
import { followJob } from "../../store/console";
import { useBlocked } from "../../store/permission";
import { useView } from "../../store/view";
import { Dialog } from "../../ui/Dialog";
import { ImportFields } from "./ImportFields";
import { EMPTY_DRAFT, type ImportDraft, requestOf } from "./importDraft";
import "./import.css";

export function ImportDialog() {
  const open = useView((s) => s.importOpen);
  return open ? <NewMap /> : null;
}

function NewMap() {
  const [draft, setDraft] = useState<ImportDraft>(EMPTY_DRAFT);
  const [job, setJob] = useState<JobReport | null>(null);
  const [failure, setFailure] = useState<string | null>(null);
  const blocked = useBlocked();
  const request = requestOf(draft);
  const close = () => useView.setState({ importOpen: false });
  const running = job !== null && (job.state === "queued" || job.state === "running");

  const start = async () => {
    if (typeof request === "string") return;
    setFailure(null);
    try {
      const last = await followJob(await api.importTerrain(request), setJob);
      if (last.state === "done") close();
      else if (last.state === "failed") setFailure(last.error?.message ?? last.doing);
    } catch (error) {
      const busy = error instanceof ApiError && error.info.code === "rover_not_idle";
      const help = "The map can only change while the rover stands idle. Wait for it, or stop it.";
      setFailure(busy ? `${sentenceOf(error)} ${help}` : sentenceOf(error));
    }
  };

  return (
    <Dialog label="New map" testId="import" onClose={close}>
      <header className="section">
        <strong>New map</strong>
        <p className="quiet small">
          The map is replaced and the simulated rover is seated anew. Plans on the old map expire.
        </p>
      </header>
      <ImportFields draft={draft} change={(part) => setDraft({ ...draft, ...part })} />
      {running && (
        <section className="section stack" role="status">
          <span className="quiet">{capital(job.doing || job.state)}…</span>
          <div className="bar">
            <span style={{ width: `${Math.round(job.progress * 100)}%` }} />
          </div>
        </section>
      )}
      {failure && (
        <p className="section trouble" role="alert" data-testid="import-failure">
          {failure}
        </p>
      )}
      <footer className="section row between">
        <span className="quiet small" data-testid="import-says">
          {typeof request === "string" ? request : blocked}
        </span>
        <span className="row">
          <button
            type="button"
            className="button"
            onClick={() => {
              if (running) api.cancelJob(job.id).catch(() => {});
              close();
            }}
          >
            {running ? "Cancel the import" : "Close"}
          </button>
          <button
            type="button"
            className="button primary"
            data-testid="import-start"
            disabled={typeof request === "string" || running || blocked !== null}
            onClick={() => void start()}
          >
            {draft.source === "recipe" ? "Generate map" : "Import map"}
          </button>
        </span>
      </footer>
    </Dialog>
  );
}
