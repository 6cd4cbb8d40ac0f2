// What the cameras saw, laid over the ground: which images, how much of it.

import { cameraLabel } from "../../lib/cameras";
import { useDrapes } from "../../store/drapes";
import { useView } from "../../store/view";

export function PictureLegend() {
  const { answer, pictureState, pictureFailure } = useDrapes();
  const views = [...(answer?.views ?? [])].sort((a, b) => b.share - a.share);
  return (
    <div className="stack" data-testid="picture" data-state={pictureState}>
      {pictureState === "loading" && (
        <p className="quiet small">Laying the images over the ground…</p>
      )}
      {pictureState === "failed" && (
        <>
          <p className="quiet small">{pictureFailure}</p>
          <button
            type="button"
            className="button"
            onClick={() => useView.setState({ tab: "map", rightOpen: true })}
          >
            Choose pairs
          </button>
        </>
      )}
      {answer && pictureState === "ready" && (
        <>
          <p className="quiet small">
            Left images of {views.length} {views.length === 1 ? "pair" : "pairs"}, each place from
            the nearest; {Math.round(answer.shape.texel_m * 1000)} mm a texel. Nothing is painted
            where none shows ground.
          </p>
          <ul className="picture-views small">
            {views.map((view) => (
              <li key={view.source}>
                <span>{cameraLabel(view.pair)}</span>
                <span className="num quiet" title="Share of the picture; brightness multiplied by">
                  {Math.round(100 * view.share)} % · × {view.gain.toFixed(2)}
                </span>
              </li>
            ))}
          </ul>
        </>
      )}
    </div>
  );
}
