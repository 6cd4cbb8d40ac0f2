// The load of a foot: measured as a tick, predicted as a band from least to most.

import type { Vec3 } from "../../api/types";
import { newtons } from "../../lib/format";
import { isOutside } from "../../lib/loads";

interface Props {
  leg: string;
  /** Vertical (N). */
  measured_n: number | null;
  /** Least, expected and most (N). */
  band_n: Vec3 | null;
  full_n: number;
}

export function LoadBar({ leg, measured_n, band_n, full_n }: Props) {
  const share = (n: number) => `${(100 * Math.min(1, Math.max(0, n / full_n))).toFixed(1)}%`;
  const outside = measured_n !== null && band_n !== null && isOutside(measured_n, band_n, full_n);
  const measured = measured_n === null ? "not measured" : `${newtons(measured_n)} measured`;
  const predicted = band_n
    ? `${newtons(band_n[0])} to ${newtons(band_n[2])} predicted, ${newtons(band_n[1])} expected`
    : "no prediction";
  const label = `${leg}: ${measured}, ${predicted}${outside ? "; outside of the band" : ""}`;
  return (
    <span className="load-bar" role="img" aria-label={label} title={label}>
      {band_n && (
        <span
          style={{
            left: share(band_n[0]),
            width: `calc(${share(band_n[2])} - ${share(band_n[0])})`,
          }}
        />
      )}
      {measured_n !== null && (
        <i className={outside ? "outside" : undefined} style={{ left: share(measured_n) }} />
      )}
    </span>
  );
}
