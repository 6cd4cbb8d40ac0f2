import { expect, test } from "vitest";

import { outageAt } from "./outage";

const at = (clock: string) => Date.parse(`2026-11-27T${clock}Z`);
const outage = {
  begin: "2026-11-27T10:00:00Z",
  end: "2026-11-27T10:01:00.5Z",
  traffic: "hold" as const,
};

test("an outage is in force from its first moment to the one before its end", () => {
  const model = { outages: [outage] };
  expect(outageAt(model, at("09:59:59.999"))).toBeNull();
  expect(outageAt(model, at("10:00:00"))).toBe(outage);
  expect(outageAt(model, at("10:01:00.499"))).toBe(outage);
  expect(outageAt(model, at("10:01:00.5"))).toBeNull();
});

test("a link without a model has none", () => {
  expect(outageAt(null, at("10:00:00"))).toBeNull();
  expect(outageAt({ outages: [] }, at("10:00:00"))).toBeNull();
});
