// What the commands that are staged next from here wait for; folded away until it is wanted.

import { useConditions } from "../../store/conditions";
import { Conditions } from "./Conditions";

export function NextConditions({ of }: { of: "plan" | "hand" }) {
  const value = useConditions((s) => s[of]);
  return (
    <details className="conditions-next" data-testid={`conditions-${of}`}>
      <summary className="small quiet">
        {value.length === 0
          ? "Only if telemetry shows…"
          : `Staged with ${value.length} ${value.length === 1 ? "condition" : "conditions"}`}
      </summary>
      <p className="quiet small">
        Asked when a command is sent, and again on board when it begins. Stops go whatever it shows.
      </p>
      <Conditions
        name={of}
        value={value}
        set={(next) => useConditions.setState({ [of]: next })}
        channels={["rover/state", "rover/stability"]}
      />
    </details>
  );
}
