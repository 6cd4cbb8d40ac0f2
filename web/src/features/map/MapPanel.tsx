// The map: ask pairs for a new version of it, see what came of it, and go back.

import { useEffect } from "react";

import { useCameras, loadCameras } from "../../store/cameras";
import { useConsole } from "../../store/console";
import { loadVersions } from "../../store/versions";
import { StatusMark } from "../../ui/StatusMark";
import { AskPairs } from "./AskPairs";
import { Choice } from "./Choice";
import { ExportMap } from "./ExportMap";
import { Outcome } from "./Outcome";
import { Progress } from "./Progress";
import { Reimage } from "./Reimage";
import { Versions } from "./Versions";
import "./map.css";

export function MapPanel() {
  const connected = useConsole((s) => s.connection === "open");
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const { cameras, failure, asking } = useCameras();
  useEffect(() => {
    if (!connected) return;
    void loadCameras();
    void loadVersions();
  }, [connected]);
  if (replaying) {
    return (
      <p className="section quiet" data-testid="map-replay">
        A replay shows the maps of its time. Pairs are asked, and maps changed, of the live rover
        only.
      </p>
    );
  }
  return (
    <>
      <section className="section stack" aria-label="Cameras">
        {cameras === null && !failure && <p className="quiet">Asking for the cameras…</p>}
        {cameras?.length === 0 && (
          <p className="quiet">
            This robot has no stereo pairs: name them in its robot.toml. Maps can still be imported.
          </p>
        )}
        {cameras && cameras.length > 0 && <Choice cameras={cameras} />}
        {failure && (
          <p className="row" role="alert">
            <StatusMark status="serious" label="failed" />
            <span data-testid="cameras-failure">{failure}</span>
            {cameras === null && (
              <button type="button" className="button" onClick={() => void loadCameras()}>
                Ask again
              </button>
            )}
          </p>
        )}
        {cameras && cameras.length > 0 && (asking ? <Progress /> : <AskPairs />)}
      </section>
      <Reimage />
      <Outcome />
      <Versions />
      <ExportMap />
    </>
  );
}
