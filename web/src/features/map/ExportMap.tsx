// The map as a file: heights and layers, classes, the cameras' picture, or its surface as triangles.

import { useState } from "react";

import { api } from "../../api/client";
import { useTerrain } from "../../store/terrain";

const FORMATS = {
  tif: "Heights and layers (GeoTIFF)",
  classes: "Traversability (GeoTIFF)",
  texture: "Camera picture (GeoTIFF)",
  obj: "Surface (OBJ)",
  ply: "Surface (PLY)",
} as const;
type Format = keyof typeof FORMATS;

const ERRORS_M = [0, 0.01, 0.02, 0.05, 0.1, 0.2];

export function ExportMap() {
  const version = useTerrain((s) => s.version);
  const [format, setFormat] = useState<Format>("tif");
  const [error_m, setError] = useState(0);
  if (!version) return null;
  const mesh = format === "obj" || format === "ply";
  const seen = (version.pairs ?? []).length > 0;
  const formats = (Object.keys(FORMATS) as Format[]).filter((f) => seen || f !== "texture");
  return (
    <section className="section stack" aria-label="Export of the map">
      <h2>Export</h2>
      <label className="field">
        <span className="sr">What is exported</span>
        <select
          data-testid="export-format"
          value={formats.includes(format) ? format : "tif"}
          onChange={(event) => setFormat(event.target.value as Format)}
        >
          {formats.map((each) => (
            <option key={each} value={each}>
              {FORMATS[each]}
            </option>
          ))}
        </select>
      </label>
      {mesh && (
        <label className="field">
          Off the surface by at most
          <select
            data-testid="export-error"
            value={error_m}
            onChange={(event) => setError(Number(event.target.value))}
          >
            {ERRORS_M.map((each) => (
              <option key={each} value={each}>
                {each === 0 ? "nothing: every triangle" : `${Math.round(100 * each)} cm`}
              </option>
            ))}
          </select>
        </label>
      )}
      <a
        className="button"
        data-testid="export"
        href={api.exportOf(version.version, format, mesh ? error_m : 0)}
        download
      >
        Download
      </a>
    </section>
  );
}
