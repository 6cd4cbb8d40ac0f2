import { describe, expect, it } from "vitest";

import type { TerrainVersion } from "../api/types";
import {
  classify,
  DIFFERENCE,
  differenceClass,
  heightSteps,
  layersOf,
  sourceStyles,
  stylesOf,
} from "./mapLayers";

const version = (change: Partial<TerrainVersion> = {}) =>
  ({
    layers: ["height", "class"],
    z_range_m: [-0.7, 0.7],
    sources: [],
    changes: null,
    ...change,
  }) as unknown as TerrainVersion;

describe("layers of a map", () => {
  it("are those that its tiles offer", () => {
    expect(layersOf(null)).toEqual([]);
    expect(layersOf(version())).toEqual(["height"]);
    const layers = ["height", "class", "sigma", "count", "age", "source", "mask"];
    const changes = { since: "a" } as TerrainVersion["changes"];
    expect(layersOf(version({ layers, changes }))).toEqual([
      "seen",
      "height",
      "sigma",
      "count",
      "age",
      "source",
      "difference",
    ]);
  });

  it("put quantities into steps, and nothing where there is none", () => {
    const sigma = Float32Array.of(0.001, 0.0051, 0.03, 0.3, NaN);
    expect([...classify("sigma", sigma, version())]).toEqual([1, 2, 4, 6, 0]);
    expect([...classify("count", Float32Array.of(0, 1, 3, 200), version())]).toEqual([0, 1, 2, 5]);
    // Seen at the newest capture, which is two minutes ago.
    expect([...classify("age", Float32Array.of(0, 500, NaN), version(), 120)]).toEqual([2, 3, 0]);
    expect([...classify("height", Float32Array.of(-0.7, 0, 0.7), version())]).toEqual([1, 4, 7]);
  });

  it("name every class that can occur", () => {
    for (const layer of ["seen", "sigma", "count", "age", "difference", "height"] as const) {
      const values = stylesOf(layer, version()).map((s) => s.value);
      expect(new Set(values).size, layer).toBe(values.length);
      expect(values, layer).toContain(0);
    }
    const flat = heightSteps([2, 2]);
    expect(flat.edges.every((e, i) => i === 0 || e > flat.edges[i - 1]!)).toBe(true);
  });

  it("show the map before and the wheels apart from pairs", () => {
    const styles = sourceStyles(["map from before", "standing wheels", "nav1", "haz1"]);
    expect(styles.map((s) => [s.value, s.name])).toEqual([
      [1, "map from before"],
      [2, "standing wheels"],
      [3, "nav1"],
      [4, "haz1"],
      [0, "unknown"],
    ]);
    expect(styles[0]!.hatch).not.toBe("none");
  });
});

describe("the difference between versions", () => {
  it("tells new, gone, lower, the same and higher", () => {
    const name = (before: number, now: number) =>
      DIFFERENCE.find((s) => s.value === differenceClass(before, now))!.name;
    expect(name(NaN, NaN)).toBe("unknown");
    expect(name(NaN, 1)).toBe("new");
    expect(name(1, NaN)).toBe("gone");
    expect(name(1, 1.009)).toBe("within 1 cm");
    expect(name(1, 1.03)).toBe("1–5 cm higher");
    expect(name(1, 0.97)).toBe("1–5 cm lower");
    expect(name(1, 1.2)).toBe("> 5 cm higher");
    expect(name(1, 0.8)).toBe("> 5 cm lower");
  });
});
