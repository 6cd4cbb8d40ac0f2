// Imported rasters over the ground: which, how strong, from a file, away.

import { useRef } from "react";

import { addRaster, removeRaster, showRaster, useDrapes } from "../../store/drapes";

export function Rasters() {
  const { rasters, shown, opacity, busy, failure } = useDrapes();
  const input = useRef<HTMLInputElement>(null);
  const chosen = rasters?.find((each) => each.id === shown) ?? null;
  return (
    <details className="rasters">
      <summary data-testid="rasters-open">Imported raster</summary>
      <div className="stack">
        {rasters !== null && rasters.length > 0 && (
          <label className="field">
            <span className="sr">Raster over the ground</span>
            <select
              data-testid="raster"
              value={shown ?? ""}
              onChange={(event) => void showRaster(event.target.value || null)}
            >
              <option value="">None</option>
              {rasters.map((each) => (
                <option key={each.id} value={each.id}>
                  {each.file}
                </option>
              ))}
            </select>
          </label>
        )}
        {chosen && (
          <>
            <label className="field">
              <span className="row between">
                Opacity <span className="num">{Math.round(100 * opacity)} %</span>
              </span>
              <input
                type="range"
                min={0.05}
                max={1}
                step={0.05}
                value={opacity}
                data-testid="raster-opacity"
                onChange={(event) => useDrapes.setState({ opacity: Number(event.target.value) })}
              />
            </label>
            {chosen.stretch && (
              <p className="quiet small num">
                black {chosen.stretch[0]!.toPrecision(4)}, white {chosen.stretch[1]!.toPrecision(4)}
              </p>
            )}
          </>
        )}
        <div className="row">
          <button
            type="button"
            className="button"
            disabled={busy}
            data-testid="raster-add"
            title="A GeoTIFF of this ground, in the coordinates of the map's file"
            onClick={() => input.current?.click()}
          >
            {busy ? "Reading…" : "Add a GeoTIFF"}
          </button>
          {chosen && (
            <button
              type="button"
              className="button bare"
              data-testid="raster-remove"
              onClick={() => void removeRaster(chosen.id)}
            >
              Remove
            </button>
          )}
          <input
            ref={input}
            type="file"
            hidden
            accept=".tif,.tiff"
            data-testid="raster-file"
            onChange={(event) => {
              const file = event.target.files?.[0];
              event.target.value = "";
              if (file) void addRaster(file);
            }}
          />
        </div>
        {failure && (
          <p className="small trouble" role="alert" data-testid="raster-failure">
            {failure}
          </p>
        )}
      </div>
    </details>
  );
}
