// How far each pair is that was asked.

import { cameraLabel, pairProgress, shareOf, STAGE_WORDS } from "../../lib/cameras";
import { capital } from "../../lib/format";
import { cancelAsking, useCameras } from "../../store/cameras";

export function Progress() {
  const asking = useCameras((s) => s.asking);
  if (!asking) return null;
  const { job, names } = asking;
  return (
    <div className="stack tight" role="status" data-testid="pairs-progress">
      <div className="row between">
        <span className="small job-doing">
          {job?.doing === "judges the ground" ? "Judging the ground" : capital(doing(job?.doing))}
        </span>
        <button
          type="button"
          className="button"
          data-testid="pairs-cancel"
          disabled={job === null}
          onClick={cancelAsking}
        >
          Cancel
        </button>
      </div>
      <ul className="pair-progress">
        {pairProgress(job, names).map((pair) => (
          <li key={pair.pair} data-testid={`progress-${pair.pair}`} data-stage={pair.stage}>
            <span>{cameraLabel(pair.pair)}</span>
            <span
              className={pair.stage === "failed" ? "trouble" : "quiet"}
              title={pair.message ?? ""}
            >
              {STAGE_WORDS[pair.stage]}
            </span>
            <span className="bar">
              <span style={{ width: `${Math.round(100 * shareOf(pair))}%` }} />
            </span>
          </li>
        ))}
      </ul>
    </div>
  );
}

function doing(text: string | undefined): string {
  if (!text) return "waits for its turn";
  const [name, what] = text.split(": ");
  return what === undefined ? text : `${cameraLabel(name!)}: ${what}`;
}
