// How plans are to be made: closed until it is asked for, and what was changed named beside it.

import { ChevronDown, ChevronRight } from "lucide-react";
import { useState } from "react";

import { useConsole } from "../../store/console";
import {
  BOUNDS_M,
  chosenOptions,
  DEFAULT_OPTIONS,
  type PlanOptions as Options,
  resetOptions,
  usePlanOptions,
} from "../../store/planOptions";
import { NumberField } from "../../ui/NumberField";
import { Segments } from "../../ui/Segments";

const PLANNERS: [Options["planner"], string, string][] = [
  [
    "auto",
    "Automatic",
    "The straight way, short random trees, A*, SBL: the first that finds a path.",
  ],
  [
    "astar",
    "A*",
    "The wheel on a coarse grid: fast and repeatable, but no way through narrow gaps.",
  ],
  ["sbl", "SBL", "Random trees from both ends, checked late: finds narrow ways, by seed."],
  ["rrt_connect", "RRT-Connect", "Two trees that grow towards each other: quick in open space."],
  ["line", "Straight line", "The wheel along a line: for comparison, fails easily."],
];

const PREFERENCES: [Options["stability"], string, string][] = [
  ["regular", "Regular", "Margin and settlement hold on the feet that stand."],
  ["conservative", "Conservative", "The slip of any one standing leg is survived too."],
  ["friction", "Friction", "The margin holds within what friction of the contacts carries too."],
];

const NAMES: Record<keyof Options, string> = {
  planner: "planner",
  stability: "stability",
  lift_m: "lift",
  terrain_lift_m: "terrain",
  obstacle_m: "obstacles",
  shift: "no body shift",
  preload: "no preload",
  drive_hold: "drives hold",
  seed: "seed",
};

export function PlanOptions() {
  const [open, setOpen] = useState(false);
  const options = usePlanOptions();
  const name = (key: keyof Options) => (key === "stability" ? options.stability : NAMES[key]);
  const chosen = chosenOptions(options).map(name);
  const Arrow = open ? ChevronDown : ChevronRight;
  return (
    <>
      <button
        type="button"
        className="options-head"
        aria-expanded={open}
        data-testid="plan-options"
        onClick={() => setOpen(!open)}
      >
        <Arrow size={14} aria-hidden />
        Options
        <span className="quiet small" data-testid="plan-options-chosen">
          {chosen.length === 0 ? "as usual" : chosen.join(", ")}
        </span>
      </button>
      {open && <Fields options={options} anyChosen={chosen.length > 0} />}
    </>
  );
}

function Fields({ options, anyChosen }: { options: Options; anyChosen: boolean }) {
  const scale = useConsole((s) => s.model?.scale ?? 1);
  const set = usePlanOptions.setState;
  const about = PLANNERS.find(([value]) => value === options.planner)?.[2];
  return (
    <div className="stack options">
      <label className="field">
        Planner
        <select
          data-testid="option-planner"
          value={options.planner}
          onChange={(event) => set({ planner: event.target.value as Options["planner"] })}
        >
          {PLANNERS.map(([value, name]) => (
            <option key={value} value={value}>
              {name}
            </option>
          ))}
        </select>
      </label>
      <p className="quiet small">{about}</p>
      <div className="options-three">
        <Metres of="lift_m" label="Lift" usual={0.2 * scale} />
        <Metres of="terrain_lift_m" label="Terrain" usual={0} />
        <Metres of="obstacle_m" label="Obstacles" usual={0} />
      </div>
      <p className="quiet small">
        Terrain raised and clearance added about obstacles; neither holds under standing wheels,
        start and goal.
      </p>
      <div className="field">
        <span id="preference">Stability while the leg is up</span>
        <Segments
          name="preference"
          labelledBy="preference"
          choices={PREFERENCES}
          value={options.stability}
          set={(stability) => set({ stability })}
          testId="preference"
        />
        <p className="quiet small">
          {PREFERENCES.find(([value]) => value === options.stability)?.[2]} Holds for reachability
          too.
        </p>
      </div>
      <Check
        label="Shift the body where needed"
        testId="option-shift"
        on={options.shift === "auto"}
        set={(on) => set({ shift: on ? "auto" : "never" })}
      />
      <Check
        label="Preload the wheel before it is relied on"
        testId="option-preload"
        on={options.preload}
        set={(preload) => set({ preload })}
      />
      <Check
        label="Wheel drives hold in place of brakes"
        testId="option-drive-hold"
        on={options.drive_hold}
        set={(drive_hold) => set({ drive_hold })}
      />
      <div className="row between options-foot">
        <Seed />
        <button
          type="button"
          className="button bare"
          data-testid="options-reset"
          disabled={!anyChosen}
          onClick={resetOptions}
        >
          Reset
        </button>
      </div>
    </div>
  );
}

function Check(props: { label: string; testId: string; on: boolean; set: (on: boolean) => void }) {
  return (
    <label className="check">
      <input
        type="checkbox"
        data-testid={props.testId}
        checked={props.on}
        onChange={(event) => props.set(event.target.checked)}
      />
      {props.label}
    </label>
  );
}

type MetresKey = keyof typeof BOUNDS_M;

function Metres({ of, label, usual }: { of: MetresKey; label: string; usual: number }) {
  const value = usePlanOptions((s) => s[of]);
  return (
    <NumberField
      label={`${label} (m)`}
      title={`0 to ${BOUNDS_M[of]} m; ${usual.toFixed(2)} m where nothing is filled in`}
      testId={`option-${of}`}
      value={value}
      usual={usual.toFixed(2)}
      step={0.05}
      max={BOUNDS_M[of]}
      set={(metres) => usePlanOptions.setState({ [of]: metres })}
    />
  );
}

function Seed() {
  const seed = usePlanOptions((s) => s.seed);
  return (
    <span className="options-seed">
      <NumberField
        label="Seed"
        title="The same seed gives the same plan"
        testId="option-seed"
        value={seed === DEFAULT_OPTIONS.seed ? null : seed}
        usual={String(DEFAULT_OPTIONS.seed)}
        step={1}
        max={Number.MAX_SAFE_INTEGER}
        whole
        set={(value) => usePlanOptions.setState({ seed: value ?? DEFAULT_OPTIONS.seed })}
      />
    </span>
  );
}
