// The version in use as cameras made it: what changed, and the captures that it is made of.

import { Image, Trash2, Undo2 } from "lucide-react";

import type { TerrainVersion, VersionPair } from "../../api/types";
import { cameraLabel, healthOf, withCameraNames } from "../../lib/cameras";
import { capital, degrees, percent, signless } from "../../lib/format";
import { formatAge, parseTime } from "../../lib/time";
import { showLayer } from "../../store/mapLayer";
import { useServerNow } from "../../store/now";
import { showPictures } from "../../store/pictures";
import { currentVersion, fitPair, removePair, useVersions } from "../../store/versions";
import { StatusMark } from "../../ui/StatusMark";

export function Outcome() {
  const version = useVersions((s) => currentVersion(s));
  const failure = useVersions((s) => s.failure);
  const pairs = version?.pairs ?? [];
  if (!version || pairs.length === 0) {
    return failure ? <Failure text={failure} /> : null;
  }
  return (
    <section className="section stack" aria-label="Map in use">
      <h2>Map in use</h2>
      <Changes version={version} />
      {failure && <Failure text={failure} />}
      <ul className="captures">
        {[...pairs].reverse().map((pair) => (
          <Capture key={pair.source} pair={pair} version={version.version} />
        ))}
      </ul>
    </section>
  );
}

function Failure({ text }: { text: string }) {
  return (
    <p className="row" role="alert">
      <StatusMark status="serious" label="failed" />
      <span data-testid="map-failure">{text}</span>
    </p>
  );
}

function Changes({ version }: { version: TerrainVersion }) {
  const { changes } = version;
  if (!changes) return null;
  const figure = (name: string, value: number, title: string) => (
    <div title={title}>
      <dt>{name}</dt>
      <dd className="num">{value.toFixed(1)} m²</dd>
    </div>
  );
  return (
    <div className="stack tight" data-testid="changes">
      <div className="row between">
        <span className="small">{capital(withCameraNames(changes.what))}</span>
        <button
          type="button"
          className="button bare"
          data-testid="show-difference"
          title="Where heights differ from the version before"
          onClick={() => showLayer("difference")}
        >
          Difference
        </button>
      </div>
      <dl className="changes">
        {figure("new", changes.new_m2, "Ground seen for the first time")}
        {figure("changed", changes.changed_m2, "Cells whose content is another, new ones included")}
        {figure("gone", changes.gone_m2, "Ground that is hidden, contradicted or taken out now")}
      </dl>
    </div>
  );
}

function Capture({ pair, version }: { pair: VersionPair; version: string }) {
  const busy = useVersions((s) => s.busy);
  const now = useServerNow();
  const { grade, why } = healthOf(pair);
  const name = cameraLabel(pair.name);
  const shift_cm = 100 * Math.hypot(...pair.shift_m);
  const [dx, dy, dz] = pair.shift_m.map((v) => signless(100 * v, 1));
  return (
    <li className="capture" data-testid={`capture-${pair.source}`} data-pair={pair.name}>
      <div className="row">
        <StatusMark status={grade} label={why} />
        <strong>{name}</strong>
        <span className="quiet small num capture-age">
          {formatAge((now - parseTime(pair.capture_time)) / 1000)}
        </span>
        <button
          type="button"
          className="button bare icon"
          aria-label={`Pictures of ${name}`}
          title="Raw pair, rectified pair, disparity"
          data-testid={`pictures-${pair.source}`}
          onClick={() => showPictures(pair)}
        >
          <Image size={14} />
        </button>
        <button
          type="button"
          className="button bare icon"
          aria-label={`Take ${name} out of the map`}
          title="Take it out: the map is made again without it"
          data-testid={`remove-${pair.source}`}
          disabled={busy}
          onClick={() => void removePair(version, pair.source)}
        >
          <Trash2 size={14} />
        </button>
      </div>
      <p className="small quiet capture-health" title={why}>
        rows <span className="num">{pair.epipolar_px?.toFixed(2) ?? "–"} px</span>, filled{" "}
        <span className="num">{percent(pair.fill)}</span>, plane{" "}
        <span className="num">
          {pair.plane_residual_m == null ? "–" : `${(100 * pair.plane_residual_m).toFixed(1)} cm`}
        </span>
      </p>
      {pair.fit_refused ? (
        <p className="small quiet">Too little known ground to fit it to: as it says it is.</p>
      ) : (
        shift_cm > 0.05 && (
          <div className="row between small">
            <span
              className={pair.fitted ? "quiet" : "capture-unfitted"}
              title={`x ${dx}, y ${dy}, z ${dz} cm, turned by ${degrees(pair.yaw_rad, 2)}`}
            >
              {pair.fitted ? "moved by" : "not moved by"}{" "}
              <span className="num">{shift_cm.toFixed(1)} cm</span> to fit
            </span>
            <button
              type="button"
              className="button bare"
              data-testid={`fit-${pair.source}`}
              disabled={busy}
              onClick={() => void fitPair(version, pair.source, !pair.fitted)}
            >
              <Undo2 size={12} aria-hidden /> {pair.fitted ? "Undo" : "Fit again"}
            </button>
          </div>
        )
      )}
    </li>
  );
}
