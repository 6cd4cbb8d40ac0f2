// Long work under way: what it does, how far it is, and a way to end it.

import type { JobReport } from "../api/types";
import { capital } from "../lib/format";

interface Props {
  /** Null before the server has answered, or where it tells of no progress. */
  job: JobReport | null;
  /** Said meanwhile. */
  waiting: string;
  cancel: () => void;
  testId: string;
}

export function JobRow({ job, waiting, cancel, testId }: Props) {
  return (
    <div className="stack" role="status" data-testid={testId}>
      <div className="row between">
        <span className="small job-doing">{job?.doing ? capital(job.doing) : waiting}</span>
        <button type="button" className="button" data-testid={`${testId}-cancel`} onClick={cancel}>
          Cancel
        </button>
      </div>
      <div className="bar">
        <span style={{ width: `${Math.round((job?.progress ?? 0) * 100)}%` }} />
      </div>
    </div>
  );
}
