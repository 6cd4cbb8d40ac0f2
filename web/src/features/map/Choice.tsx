// The pairs on a plan of the rover: each is a box to tick where it sits, its view a wedge.

import { useRef } from "react";

import type { CameraAnswer, Vec2, Vec3 } from "../../api/types";
import { cameraLabel, cameraMark, intoBase, looksAt } from "../../lib/cameras";
import { fileSize, legLabel } from "../../lib/format";
import { choose, toggle, useCameras } from "../../store/cameras";
import { useConsole, useLive } from "../../store/console";
import { useSelection } from "../../store/selection";

const WIDTH = 278;
const HEIGHT = 214;

export function Choice({ cameras }: { cameras: CameraAnswer[] }) {
  const base = useConsole((s) => s.model?.base_link);
  const onBase = cameras.filter((c) => c.link === base || base === undefined);
  const elsewhere = cameras.filter((c) => !onBase.includes(c));
  return (
    <>
      <Presets cameras={cameras} />
      <Plan cameras={onBase} />
      {elsewhere.length > 0 && (
        <ul className="pairs-elsewhere">
          {elsewhere.map((camera) => (
            <li key={camera.name}>
              <Tick camera={camera} className="check small">
                {cameraLabel(camera.name)} <span className="quiet">on {camera.link}</span>
              </Tick>
            </li>
          ))}
        </ul>
      )}
    </>
  );
}

function Presets({ cameras }: { cameras: CameraAnswer[] }) {
  const chosen = useCameras((s) => s.chosen);
  const busy = useCameras((s) => s.asking !== null);
  const leg = useSelection((s) => s.leg);
  const rover = useLive((c) => c.rover?.message ?? null);
  const foot = leg === null ? undefined : rover?.contact_points_m[leg];
  const point = foot && rover ? intoBase(rover.state.base, foot) : null;
  const near = point ? cameras.filter((c) => looksAt(c, point)).map((c) => c.name) : [];
  const set = (names: string[]) => choose(names);
  return (
    <div className="row between">
      <h2>Pairs</h2>
      <span className="row pair-presets">
        {leg !== null && near.length > 0 && (
          <button
            type="button"
            className="button bare"
            data-testid="pairs-leg"
            disabled={busy}
            title={`The pairs that look at the foot of ${legLabel(leg)}`}
            onClick={() => set(near)}
          >
            At {legLabel(leg)}
          </button>
        )}
        <button
          type="button"
          className="button bare"
          data-testid="pairs-all"
          disabled={busy || chosen.length === cameras.length}
          onClick={() => set(cameras.map((c) => c.name))}
        >
          All
        </button>
        <button
          type="button"
          className="button bare"
          data-testid="pairs-none"
          disabled={busy || chosen.length === 0}
          onClick={() => set([])}
        >
          None
        </button>
      </span>
    </div>
  );
}

function Plan({ cameras }: { cameras: CameraAnswer[] }) {
  const chosen = useCameras((s) => s.chosen);
  const selected = useSelection((s) => s.leg);
  const feet = useFeet();
  const box = useRef<HTMLDivElement>(null);
  const far = Math.max(1, ...feet.map(([, p]) => Math.hypot(p[0], p[1])));
  const unit = (0.5 * HEIGHT - 14) / far;
  // The rover looks up on the plan: x goes up, y to the left.
  const at = ([x, y]: Vec2 | Vec3): Vec2 => [WIDTH / 2 - y * unit, HEIGHT / 2 - x * unit];
  const hull = hullOf(cameras.map((c) => [c.position_m[0], c.position_m[1]]));
  const order = [...cameras].sort((a, b) => bearing(a) - bearing(b));
  const step = (from: CameraAnswer, by: number) => {
    const next = order[(order.indexOf(from) + by + order.length) % order.length]!;
    box.current?.querySelector<HTMLInputElement>(`[data-pair="${next.name}"]`)?.focus();
  };
  return (
    <div
      className="rig"
      ref={box}
      role="group"
      aria-label="Stereo pairs on the rover, ahead is up. Arrow keys go around, space chooses."
    >
      <svg width={WIDTH} height={HEIGHT} viewBox={`0 0 ${WIDTH} ${HEIGHT}`} aria-hidden>
        {cameras
          .filter((c) => chosen.includes(c.name))
          .map((c) => (
            <path key={c.name} className={`rig-view ${c.kind}`} d={wedge(c, at, unit, far)} />
          ))}
        {feet.map(([leg, p]) => {
          const [x, y] = at(p);
          const [u, v] = at([0.42 * p[0], 0.42 * p[1]]);
          return (
            <g key={leg} className={leg === selected ? "rig-leg chosen" : "rig-leg"}>
              <path d={`M${u} ${v}L${x} ${y}`} />
              <circle cx={x} cy={y} r={8} />
              <text x={x} y={y + 4}>
                {leg.replace(/^leg/, "")}
              </text>
            </g>
          );
        })}
        <path className="rig-body" d={`M${hull.map((p) => at(p).join(" ")).join("L")}Z`} />
        <path className="rig-ahead" d={`M${WIDTH / 2 - 5} 11l5 -8 5 8`} />
      </svg>
      {cameras.map((camera) => {
        const [x, y] = at(camera.position_m);
        return (
          <Tick
            key={camera.name}
            camera={camera}
            className={`rig-pair ${camera.kind}`}
            style={{ left: x, top: y }}
            onStep={(by) => step(camera, by)}
          >
            <span>{cameraMark(camera.name)}</span>
          </Tick>
        );
      })}
    </div>
  );
}

interface TickProps {
  camera: CameraAnswer;
  className: string;
  style?: React.CSSProperties;
  onStep?: (by: number) => void;
  children: React.ReactNode;
}

const ARROWS: Record<string, number> = {
  ArrowLeft: 1,
  ArrowUp: 1,
  ArrowRight: -1,
  ArrowDown: -1,
};

function Tick({ camera, className, style, onStep, children }: TickProps) {
  const on = useCameras((s) => s.chosen.includes(camera.name));
  const busy = useCameras((s) => s.asking !== null);
  const [near, far] = camera.range_m;
  const title = `${cameraLabel(camera.name)}: ${near.toFixed(1)} to ${far.toFixed(0)} m, ${fileSize(camera.raw_bytes)} at full size`;
  return (
    <label className={className} style={style} title={title} data-on={on}>
      <input
        type="checkbox"
        checked={on}
        disabled={busy}
        aria-label={cameraLabel(camera.name)}
        data-testid={`pair-${camera.name}`}
        data-pair={camera.name}
        onChange={() => toggle(camera.name)}
        onKeyDown={(event) => {
          const by = ARROWS[event.key];
          if (by === undefined || !onStep) return;
          event.preventDefault();
          onStep(by);
        }}
      />
      {children}
    </label>
  );
}

/** Where the feet are in the frame of the base (m). */
function useFeet(): [string, Vec3][] {
  const rover = useLive((c) => c.rover?.message ?? null);
  if (!rover) return [];
  return Object.entries(rover.contact_points_m).map(([leg, p]) => [
    leg,
    intoBase(rover.state.base, p),
  ]);
}

const bearing = ({ position_m: [x, y] }: CameraAnswer) => Math.atan2(y, x);

/** The outline of the places of pairs: about that of the chassis. */
function hullOf(points: Vec2[]): Vec2[] {
  const far = Math.max(...points.map(([x, y]) => Math.hypot(x, y)));
  const outer = points.filter(([x, y]) => Math.hypot(x, y) > 0.8 * far);
  return outer.sort((a, b) => Math.atan2(a[1], a[0]) - Math.atan2(b[1], b[0]));
}

/** What a pair has in view, as a wedge as long as the plan has room for. */
function wedge(camera: CameraAnswer, at: (p: Vec2) => Vec2, unit: number, far: number): string {
  const [x, y] = camera.position_m;
  // A pair that looks down sees the ground not far from it.
  const steep = Math.abs(camera.elevation_rad) > 0.5;
  const length = steep ? 0.75 * far : Math.min(camera.range_m[1], 1.3 * far);
  const end = (turn: number): Vec2 => {
    const angle = camera.azimuth_rad + turn * (camera.field_of_view_rad / 2);
    return at([x + length * Math.cos(angle), y + length * Math.sin(angle)]);
  };
  const radius = length * unit;
  return `M${at([x, y]).join(" ")}L${end(-1).join(" ")}A${radius} ${radius} 0 0 0 ${end(1).join(" ")}Z`;
}
