// The versions that are kept: when, of what, and back to one of them.

import type { TerrainVersion } from "../../api/types";
import { withCameraNames } from "../../lib/cameras";
import { capital } from "../../lib/format";
import { formatClock, parseTime } from "../../lib/time";
import { selectVersion, useVersions } from "../../store/versions";

export function Versions() {
  const { versions, current, busy } = useVersions();
  if (!versions) return null;
  const ordered = [...versions].sort((a, b) => parseTime(b.created) - parseTime(a.created));
  return (
    <section className="section stack" aria-label="Versions of the map">
      <h2 id="versions-title">Versions</h2>
      <ul className="versions" role="radiogroup" aria-labelledby="versions-title">
        {ordered.map((version) => (
          <li key={version.version}>
            <label className="version" data-testid={`version-${version.version}`}>
              <input
                type="radio"
                name="map-version"
                disabled={busy}
                checked={version.version === current}
                onChange={() => void selectVersion(version.version)}
              />
              <span className="version-text" title={`${version.version}: ${version.source}`}>
                {titleOf(version)}
              </span>
              <span className="num quiet">{formatClock(parseTime(version.created))}</span>
            </label>
          </li>
        ))}
      </ul>
      {versions.length === 1 && (
        <p className="quiet small">The imported map. What pairs see becomes a version beside it.</p>
      )}
    </section>
  );
}

function titleOf({ changes, source }: TerrainVersion): string {
  const text = changes ? changes.what : source;
  return capital(withCameraNames(text));
}
