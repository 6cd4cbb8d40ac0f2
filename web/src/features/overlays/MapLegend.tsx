// What the layers of the map and the coverage of pairs show.

import { COVERAGE } from "../../lib/coverage";
import { LAYER_NAMES, layersOf, type MapLayer, stylesOf } from "../../lib/mapLayers";
import { useCameras } from "../../store/cameras";
import { layerShown, showLayer, useMapLayer } from "../../store/mapLayer";
import { useTerrain } from "../../store/terrain";
import { useView } from "../../store/view";
import { Legend } from "./Legend";

export function MapLegend() {
  const version = useTerrain((s) => s.version);
  const { layer: wanted, shown, state, failure } = useMapLayer();
  const layers = layersOf(version);
  const layer = layerShown(wanted, version);
  if (!version || layer === null) return <p className="quiet small">No map has come yet.</p>;
  const ready = state === "ready" && shown?.of === version.version && shown.layer === layer;
  const styles = stylesOf(layer, version);
  const present = new Set(ready ? shown.classes : []);
  // Classes that do not occur only take room, but for steps, of which the ends tell something.
  const sparse = layer === "seen" || layer === "source" || layer === "difference";
  const told = sparse && ready ? styles.filter((s) => present.has(s.value)) : styles;
  return (
    <>
      <label className="field">
        <span className="sr">Layer of the map</span>
        <select
          data-testid="map-layer"
          value={layer}
          onChange={(event) => showLayer(event.target.value as MapLayer)}
        >
          {layers.map((each) => (
            <option key={each} value={each}>
              {LAYER_NAMES[each]}
            </option>
          ))}
        </select>
      </label>
      {state === "failed" ? <p className="small trouble">{failure}</p> : <Legend styles={told} />}
      <p
        className="sr"
        role="status"
        data-testid="map-layer-state"
        data-state={ready ? "ready" : state === "ready" ? "loading" : state}
      >
        {state === "loading" ? "Layer is loaded" : ""}
      </p>
      {layers.length === 1 && (
        <p className="quiet small">
          Imported, not seen: how sure, how old and by whom is told of maps that cameras made.
        </p>
      )}
    </>
  );
}

export function CoverageLegend() {
  const { coverage, chosen, looking } = useCameras();
  if (!coverage && !looking) {
    return (
      <div className="stack">
        <p className="quiet small">
          {chosen.length === 0 ? "Choose pairs to see what they would see." : "Not known yet."}
        </p>
        <button
          type="button"
          className="button"
          onClick={() => useView.setState({ tab: "map", rightOpen: true })}
        >
          Choose pairs
        </button>
      </div>
    );
  }
  return <Legend styles={COVERAGE} />;
}
