import { describe, expect, it } from "vitest";

import type { StabilityDerived } from "../api/types";
import { joules, type MarginRow, marginTable } from "./margins";

const ASKED = { margin_m: 0.15, settlement_m: 0.1 };

const polygon = (margin_m: number, critical: string | null = "leg2 and leg3") => ({
  polygon_m: [
    [0, 0],
    [1, 0],
    [0, 1],
  ],
  area_m2: 0.5,
  margin_m,
  critical,
});

const area = (margin_m: number) => ({
  kind: "area",
  region: polygon(margin_m, "leg1, leg2"),
  capped: false,
});

const FORCES = {
  friction: area(0.4),
  friction_conservative: { kind: "empty", why_empty: "no center of mass is held", capped: false },
  torque: { ...area(0.3), capped: true },
  slip_margin: 0.2,
  energy_margin_m: 0.5,
  energy_margin_j: 900,
  energy_edge: ["leg2", "leg3"],
  contact_forces_n: { leg1: [0, 0, 1], leg2: [0, 0, 1], leg3: [0, 0, 1] },
  least_torque_ratio: 0.5,
  least_torque_joint: "leg2_knee_pitch",
  load_torque_ratio: 1.2,
  load_torque_joint: "leg3_knee_pitch",
  torque_safe: false,
  friction_coefficient: 0.7,
};

const STANCE = {
  com_m: [0, 0, 1],
  regular: polygon(0.6),
  conservative: null,
  conservative_kind: "empty",
  settlement_margin_m: -0.02,
  settlement_leg: "leg4",
  torque_joint: "",
  torque_ratio: 0,
  torque_ratios: {},
  forces: FORCES,
};

function rows(change: object = {}): Record<string, MarginRow> {
  const stability = { ...STANCE, ...change } as unknown as StabilityDerived;
  const { regions, others, torques } = marginTable(stability, ASKED);
  return Object.fromEntries([...regions, ...others, ...torques].map((row) => [row.key, row]));
}

const withForces = (change: object) => rows({ forces: { ...FORCES, ...change } });

describe("the table of margins", () => {
  it("has every kind, in one order", () => {
    expect(Object.keys(rows())).toEqual([
      "regular",
      "settlement",
      "conservative",
      "friction",
      "frictionLoss",
      "torque",
      "energy",
      "slip",
      "leastTorque",
      "loadTorque",
    ]);
  });

  it("names value, status and what decides", () => {
    const told = rows();
    expect(told.regular).toMatchObject({
      value: "0.60 m",
      status: "normal",
      critical: "legs 2–3",
    });
    expect(told.settlement).toMatchObject({ value: "−0.02 m", status: "caution" });
    expect(told.settlement!.critical).toBe("leg 4");
    expect(told.energy).toMatchObject({ value: "0.50 m", beside: "900 J", critical: "legs 2–3" });
    expect(told.loadTorque).toMatchObject({ value: "120 %", status: "critical" });
    expect(told.loadTorque!.critical).toBe("leg 3 knee pitch");
    expect(told.torque).toMatchObject({ beside: "capped" });
  });

  it("is worse below what the rule asks for, and worst outside", () => {
    expect(rows({ regular: polygon(0.1) }).regular!.status).toBe("serious");
    expect(rows({ regular: polygon(-0.1) }).regular!.status).toBe("critical");
    expect(withForces({ friction: area(0.1) }).friction!.status).toBe("serious");
    expect(withForces({ slip_margin: -0.1 }).slip!.status).toBe("critical");
    expect(withForces({ slip_margin: null }).slip).toMatchObject({
      value: "none",
      status: "critical",
    });
  });

  it("says that there is no region and why", () => {
    expect(rows().frictionLoss).toMatchObject({
      value: "none",
      status: "caution",
      why: "No center of mass is held",
    });
    const point = { conservative: polygon(-0.3, null), conservative_kind: "point" };
    expect(rows(point).conservative).toMatchObject({ value: "−0.30 m", beside: "a point" });
    expect(rows({ regular: null }).regular).toMatchObject({ value: "none", status: "critical" });
  });

  it("invents nothing where nothing is told", () => {
    const told = rows({ forces: null });
    for (const key of ["friction", "frictionLoss", "torque", "energy", "slip", "leastTorque"]) {
      expect(told[key], key).toMatchObject({ value: "–", status: "off" });
    }
    const stability = { ...STANCE, forces: null } as unknown as StabilityDerived;
    expect(marginTable(stability, ASKED).torqueSafe).toBeNull();
  });
});

describe("joules", () => {
  it("become kilojoules where there are many", () => {
    expect([joules(12.3), joules(9940), joules(12_340)]).toEqual(["12 J", "9940 J", "12.3 kJ"]);
  });
});
