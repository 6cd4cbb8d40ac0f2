// The checks of a plan: those that fail first, then those that hold on an assumption.

import { useState } from "react";

import type { PlanFinding } from "../../api/types";
import { capital, degrees, metres, percent, readable, words } from "../../lib/format";
import { StatusMark } from "../../ui/StatusMark";

export function Findings({ findings }: { findings: PlanFinding[] }) {
  const failed = findings.filter((f) => !f.ok);
  const assumed = findings.filter((f) => f.assumed);
  const [open, setOpen] = useState(failed.length + assumed.length > 0);
  if (findings.length === 0) return null;
  const sorted = [...failed, ...assumed, ...findings.filter((f) => f.ok && !f.assumed)];
  const held = `All ${findings.length} checks hold`;
  return (
    <section className="section">
      <button
        type="button"
        className="findings-head"
        aria-expanded={open}
        data-testid="findings"
        onClick={() => setOpen(!open)}
      >
        <StatusMark
          status={failed.length > 0 ? "serious" : assumed.length > 0 ? "caution" : "normal"}
        />
        {failed.length > 0
          ? `${failed.length} of ${findings.length} checks do not hold`
          : assumed.length > 0
            ? `${held}, ${assumed.length} on an assumption`
            : held}
        <span className="quiet">{open ? "Hide" : "Show"}</span>
      </button>
      {open && (
        <ul className="findings">
          {sorted.map((finding, i) => (
            <Row key={i} finding={finding} />
          ))}
        </ul>
      )}
    </section>
  );
}

/** What is to spare, in the unit of the check. */
function toSpare(check: string, margin: number): string {
  if (check === "joint_limits") return degrees(margin);
  return check === "torque" ? percent(margin) : metres(margin, 3);
}

function Row({ finding }: { finding: PlanFinding }) {
  const place = readable([finding.where, finding.detail].filter(Boolean).join(": "));
  return (
    <li className="finding">
      <StatusMark
        status={finding.assumed ? "caution" : finding.ok ? "normal" : "serious"}
        label={finding.assumed ? "holds on an assumption" : finding.ok ? "holds" : "fails"}
      />
      <div>
        {capital(words(finding.check))}
        {place && <div className="quiet small">{place}</div>}
      </div>
      {finding.margin != null && Number.isFinite(finding.margin) && (
        <span className="num" title="To spare">
          {toSpare(finding.check, finding.margin)}
        </span>
      )}
    </li>
  );
}
