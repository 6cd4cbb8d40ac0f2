import { ChevronLeft, ChevronRight } from "lucide-react";
import { useEffect } from "react";

import { Attention } from "./features/attention/Attention";
import { Banner } from "./features/banner/Banner";
import { CellReadout } from "./features/cell/CellReadout";
import { EstopBanner } from "./features/estop/Estop";
import { GlobalBar } from "./features/global-bar/GlobalBar";
import { HandPanel } from "./features/hand/HandPanel";
import { ImportDialog } from "./features/import/ImportDialog";
import { KeySheet } from "./features/keys/KeySheet";
import { useHotkeys } from "./features/keys/useHotkeys";
import { LegsPanel, StancePanel } from "./features/legs/LegsPanel";
import { LogPanel } from "./features/log/LogPanel";
import { MapPanel } from "./features/map/MapPanel";
import { Pictures } from "./features/map/Pictures";
import { DrawingPanel } from "./features/overlays/DrawingPanel";
import { OverlayPanel } from "./features/overlays/OverlayPanel";
import { useReachability } from "./features/overlays/useReachability";
import { PlanPanel } from "./features/plan/PlanPanel";
import { Timeline } from "./features/replay/Timeline";
import { SceneView } from "./features/scene/SceneView";
import { StabilityPanel } from "./features/stability/StabilityPanel";
import { StepStrip } from "./features/step-strip/StepStrip";
import { TelemetryPanel } from "./features/telemetry/TelemetryPanel";
import { startAuthority } from "./store/authority";
import { startCameras } from "./store/cameras";
import { start, useConsole } from "./store/console";
import { startEnergy } from "./store/energy";
import { startMargins } from "./store/marginHistory";
import { startDrapes } from "./store/drapes";
import { startMapLayer } from "./store/mapLayer";
import { startPosture } from "./store/posture";
import { loadTerrain, useTerrain } from "./store/terrain";
import { type RightTab, useView } from "./store/view";

const LEFT_PX = 232;
const RIGHT_PX = 304;

/** Fetches the map whenever its version changes, in live as in replay. */
function useTerrainOfVersion(): void {
  const version = useConsole((s) => s.terrainVersion);
  const connected = useConsole((s) => s.connection === "open");
  useEffect(() => {
    if (version !== null) void loadTerrain(version);
  }, [version]);
  useEffect(() => {
    if (connected && version !== null && useTerrain.getState().state === "failed") {
      void loadTerrain(version);
    }
  }, [connected, version]);
}

export function App() {
  useEffect(start, []);
  useEffect(startMargins, []);
  useEffect(startEnergy, []);
  useEffect(startPosture, []);
  useEffect(startCameras, []);
  useEffect(startMapLayer, []);
  useEffect(startAuthority, []);
  useEffect(startDrapes, []);
  useHotkeys();
  useTerrainOfVersion();
  useReachability();
  const replay = useConsole((s) => s.stream.replayState);
  const simulated = useConsole((s) => s.simulated);
  const { leftOpen, rightOpen } = useView();
  const edge = replay ? "app replay-edge" : simulated ? "app sim-edge" : "app";
  return (
    <div className={edge} data-mode={replay ? "replay" : "live"}>
      <GlobalBar />
      <Banner />
      <EstopBanner />
      <main className="stage-area">
        <SceneView left={leftOpen ? LEFT_PX + 16 : 0} right={rightOpen ? RIGHT_PX + 16 : 0} />
        <LeftPanels />
        <RightPanel />
      </main>
      {replay ? <Timeline replay={replay} /> : <StepStrip />}
      <ImportDialog />
      <Pictures />
      <KeySheet />
    </div>
  );
}

function LeftPanels() {
  const open = useView((s) => s.leftOpen);
  const toggle = () => useView.setState({ leftOpen: !open });
  return (
    <>
      {open && (
        <div className="left-panels">
          <div className="panel left-main">
            <LegsPanel />
            <StancePanel />
            <OverlayPanel />
            <DrawingPanel />
          </div>
          <CellReadout />
        </div>
      )}
      <button
        type="button"
        className={open ? "edge-toggle left open" : "edge-toggle left"}
        aria-label={open ? "Hide the left panels" : "Show the left panels"}
        title={open ? "Hide" : "Legs and overlays"}
        onClick={toggle}
      >
        {open ? <ChevronLeft size={16} /> : <ChevronRight size={16} />}
      </button>
    </>
  );
}

const TABS: [RightTab, string][] = [
  ["step", "Step"],
  ["hand", "By hand"],
  ["map", "Map"],
  ["stability", "Stability"],
  ["telemetry", "Telemetry"],
  ["log", "Log"],
];

const TAB_STEPS: Record<string, (at: number) => number> = {
  ArrowRight: (at) => (at + 1) % TABS.length,
  ArrowLeft: (at) => (at + TABS.length - 1) % TABS.length,
  Home: () => 0,
  End: () => TABS.length - 1,
};

/** Arrow keys go from tab to tab; only the open one is a stop of the tab key. */
function onTabKey(event: React.KeyboardEvent): void {
  const step = TAB_STEPS[event.key];
  if (!step) return;
  event.preventDefault();
  const { tab } = useView.getState();
  const [next] = TABS[step(TABS.findIndex(([value]) => value === tab))]!;
  useView.setState({ tab: next });
  document.getElementById(`tab-${next}`)?.focus();
}

function RightPanel() {
  const { tab, rightOpen } = useView();
  return (
    <>
      {rightOpen && (
        <div className="panel right-panel">
          <div className="tabs" role="tablist" aria-label="Panels">
            {TABS.map(([value, label]) => (
              <button
                key={value}
                type="button"
                role="tab"
                aria-selected={tab === value}
                data-testid={`tab-${value}`}
                id={`tab-${value}`}
                aria-controls="right-body"
                tabIndex={tab === value ? 0 : -1}
                onClick={() => useView.setState({ tab: value })}
                onKeyDown={onTabKey}
              >
                {label}
              </button>
            ))}
          </div>
          <Attention />
          <div
            className="right-body"
            id="right-body"
            role="tabpanel"
            aria-labelledby={`tab-${tab}`}
          >
            {tab === "step" && <PlanPanel />}
            {tab === "hand" && <HandPanel />}
            {tab === "map" && <MapPanel />}
            {tab === "stability" && <StabilityPanel />}
            {tab === "telemetry" && <TelemetryPanel />}
            {tab === "log" && <LogPanel />}
          </div>
        </div>
      )}
      <button
        type="button"
        className={rightOpen ? "edge-toggle right open" : "edge-toggle right"}
        aria-label={rightOpen ? "Hide the right panel" : "Show the right panel"}
        title={rightOpen ? "Hide" : "Step, commands and telemetry"}
        onClick={() => useView.setState({ rightOpen: !rightOpen })}
      >
        {rightOpen ? <ChevronRight size={16} /> : <ChevronLeft size={16} />}
      </button>
    </>
  );
}
