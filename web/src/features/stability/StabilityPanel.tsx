// How far the rover is from tipping, slipping and overloading a joint: every margin, now and lately.

import { useChannels, useConsole } from "../../store/console";
import { EnergySlice } from "./EnergySlice";
import { MarginStrip } from "./MarginStrip";
import { MarginTable } from "./MarginTable";
import { Rehearsal } from "./Rehearsal";
import "./stability.css";

export function StabilityPanel() {
  const stability = useChannels((c) => c.stability?.message ?? null);
  const model = useConsole((s) => s.model);
  if (!stability || !model) return <p className="section quiet">No stability known yet.</p>;
  return (
    <>
      <MarginTable stability={stability} model={model} />
      <MarginStrip needed_m={model.margin_m} />
      <Rehearsal />
      <EnergySlice />
    </>
  );
}
