// A class of an overlay as the ground shows it: color and hatching.

import { type ClassStyle, HATCH } from "../scene/palette";

const LINES: Record<number, string> = {
  [HATCH.none]: "",
  [HATCH.rising]: "M-2 14L14 -2M4 20L20 4M-8 8L8 -8",
  [HATCH.falling]: "M-2 2L10 14M6 -2L20 12",
  [HATCH.cross]: "M-2 14L14 -2M6 18L22 2M-2 -2L14 14M8 -4L24 12",
  [HATCH.level]: "M0 3h20M0 7h20M0 11h20",
  [HATCH.upright]: "M3 0v12M8 0v12M13 0v12M18 0v12",
  [HATCH.dots]: "M3 3h2M9 3h2M15 3h2M3 9h2M9 9h2M15 9h2",
};

export function Swatch({ style }: { style: ClassStyle }) {
  return (
    <svg width="20" height="12" viewBox="0 0 20 12" className="swatch" aria-hidden>
      <rect width="20" height="12" fill={style.color} />
      <path
        d={LINES[HATCH[style.hatch]]}
        stroke="#0c1117"
        strokeOpacity="0.75"
        strokeWidth="1.6"
        fill="none"
      />
    </svg>
  );
}
