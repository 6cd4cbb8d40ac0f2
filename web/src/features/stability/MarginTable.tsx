// Every margin with its status and what decides it.

import type { RoverModel, StabilityDerived } from "../../api/types";
import { type MarginRow, marginTable } from "../../lib/margins";
import { StatusMark } from "../../ui/StatusMark";

interface Props {
  stability: StabilityDerived;
  model: RoverModel;
}

export function MarginTable({ stability, model }: Props) {
  const { regions, others, torques, torqueSafe } = marginTable(stability, model);
  return (
    <section className="section of-rover" aria-label="Margins">
      <table className="margins" data-testid="margins">
        <thead>
          <tr>
            <th scope="col">Margins</th>
            <th />
            <th scope="col" className="right">
              value
            </th>
            <th scope="col">decided by</th>
          </tr>
        </thead>
        <Rows rows={regions} />
        <Rows rows={others} />
        <Rows rows={torques} />
      </table>
      <TorqueSafe safe={torqueSafe} />
      {!stability.forces && (
        <p className="quiet small">
          {stability.regular
            ? "Friction, energy and joint margins are not told in this log."
            : "Nothing is known of friction and energy: no foot stands."}
        </p>
      )}
    </section>
  );
}

function Rows({ rows }: { rows: MarginRow[] }) {
  return (
    <tbody>
      {rows.map((row) => (
        <Row key={row.key} row={row} />
      ))}
    </tbody>
  );
}

function Row({ row }: { row: MarginRow }) {
  const { key, name, about, value, beside, status, says, critical, why } = row;
  return (
    <>
      <tr data-testid={`margin-${key}`} data-status={status}>
        <th scope="row" title={about}>
          {name}
        </th>
        <td>
          <span title={says}>
            <StatusMark status={status} label={says} />
          </span>
        </td>
        <td className="num right">
          {value}
          {beside && <span className="margin-beside">{beside}</span>}
        </td>
        <td className="margin-critical" title={critical}>
          {critical}
        </td>
      </tr>
      {why && (
        <tr className="margin-why">
          <td colSpan={4} className="quiet small">
            {why}
          </td>
        </tr>
      )}
    </>
  );
}

const SAFE_TITLE =
  "The best forces, the loads within their errors, and lifted legs leave all joints within their limits";

function TorqueSafe({ safe }: { safe: boolean | null }) {
  const [status, text] =
    safe === null
      ? (["off", "Torque-safe: not known"] as const)
      : safe
        ? (["normal", "Torque-safe"] as const)
        : (["serious", "Not torque-safe"] as const);
  return (
    <p className="row torque-safe" title={SAFE_TITLE} data-testid="torque-safe" data-safe={safe}>
      <StatusMark status={status} />
      {text}
    </p>
  );
}
