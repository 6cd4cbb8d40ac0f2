// Stability in one glance: every margin with what decides it, its regions over the ground, how it went, the
// energy surface, and why a leg cannot stand at a cell.

import type { LogList } from "../src/api/types";
import { type Console, expect, test } from "./support/console";

const MARGINS = [
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
];

test("every margin is told, drawn and kept", async ({ ops, page }) => {
  await ops.open();
  await ops.at("all-margins").click();

  await test.step("the table has every kind with its status and figure", async () => {
    for (const key of MARGINS) {
      const row = ops.at(`margin-${key}`);
      await expect(row).toContainText(/\d/);
      await expect(row.getByRole("img")).toBeVisible();
    }
    await expect(ops.at("margin-regular")).toHaveAttribute("data-status", "normal");
    await expect(ops.at("margin-regular")).toContainText(/legs \d–\d/);
    await expect(ops.at("margin-energy")).toContainText(/ J/);
    await expect(ops.at("margin-loadTorque")).toContainText(/leg \d \w+/);
    await expect(ops.at("torque-safe")).toHaveText("Torque-safe");
  });

  await test.step("kinds of polygons are drawn as chosen", async () => {
    expect(await drawn(ops)).toEqual(["regular", "conservative"]);
    await ops.at("regions-open").click();
    await ops.at("region-friction").check();
    await expect.poll(() => drawn(ops)).toEqual(["regular", "conservative", "friction"]);
    await ops.at("region-torque").check();
    await ops.at("region-conservative").uncheck();
    await expect.poll(() => drawn(ops)).toEqual(["regular", "friction", "torque"]);
    await ops.at("region-torque").uncheck();
  });

  await test.step("the strip gathers samples and reads them out", async () => {
    const strip = ops.at("margin-history");
    await expect
      .poll(async () => Number(await strip.getAttribute("data-samples")))
      .toBeGreaterThan(4);
    await expect(ops.at("strip-at")).toHaveText("on-board time");
    const box = (await strip.boundingBox())!;
    await page.mouse.move(box.x + box.width - 4, box.y + box.height / 2);
    await expect(ops.at("strip-at")).toHaveText(/^\d\d:\d\d:\d\d/);
    await expect(ops.at("strip-friction")).toHaveText(/^\d+\.\d\d m$/);
  });

  await test.step("the energy surface appears with its legend, and goes", async () => {
    await ops.at("overlay-energy").check();
    await expect(ops.at("energy-legend")).toHaveAttribute("data-state", "ready");
    await expect(ops.at("energy-own")).toHaveText(/^\d+\.\d\d m · \d+ J$/);
    await expect.poll(() => ops.hook((hook) => hook.energyTriangles())).toBeGreaterThan(100);
    await ops.at("overlay-none").check();
    await expect.poll(() => ops.hook((hook) => hook.energyTriangles())).toBe(0);
  });

  await test.step("each foot's load is shown within what was predicted", async () => {
    await ops.at("tab-telemetry").click();
    await expect(page.getByRole("img", { name: /leg 1: \d+ N measured, \d+ N to/ })).toBeVisible();
  });
});

test("two gestures tell why a leg cannot stand at a cell", async ({ ops, page }) => {
  await ops.open();
  await page.keyboard.press("1");
  await ops.clickGround(await ops.groundBeside("leg1", 0.25, -0.3));
  await ops.at("why-ask").click();
  await expect(ops.at("why-not")).toContainText("Leg 1: reachable");
  await expect(ops.at("why-not")).toContainText("margin");
  await ops.clickGround(await ops.groundBeside("leg1", 0.9, 0));
  await expect(ops.at("why-not")).toContainText("Leg 1: unreachable");
  await expect(ops.at("why-not")).toContainText("missing");
});

test("after a jump in a replay the strip shows the minutes before", async ({
  ops,
  page,
  server,
}) => {
  await ops.open();
  const strip = ops.at("margin-history");
  // In one look: where a replay has no telemetry yet, there is no strip.
  const samples = () =>
    strip.evaluateAll((strips) => Number((strips[0] as HTMLElement)?.dataset.samples ?? 0));
  await ops.at("all-margins").click();
  await expect.poll(samples, { timeout: 30_000 }).toBeGreaterThan(10);
  const { logs } = await server.get<LogList>("logs");
  await ops.at("mode-menu").click();
  await ops.at(`replay-${logs[0]!.id}`).click();
  await expect(ops.at("mode")).toHaveText("REPLAY");
  await expect(ops.at("opening")).toHaveCount(0);
  await ops.at("replay-toggle").click();
  // Nothing was played of what lies between, and nothing is played now.
  await ops.at("replay-scrub").focus();
  await page.keyboard.press("End");
  await expect.poll(samples).toBeGreaterThan(8);
  await expect(ops.at("strip-regular")).toHaveText(/^\d\.\d\d m$/);
  const box = (await strip.boundingBox())!;
  await page.mouse.move(box.x + box.width - 4, box.y + box.height / 2);
  await expect(ops.at("strip-at")).toHaveText(/^\d\d:\d\d:\d\d/);
  await page.keyboard.press("Home");
  await expect.poll(samples).toBeLessThan(3);
});

test("one choice of stability goes with plans and reachability", async ({ ops, page, watch }) => {
  const asked: unknown[] = [];
  await page.route(/\/analysis\/reachability$/, async (route) => {
    const { stability } = route.request().postDataJSON() as { stability: unknown };
    asked.push(stability);
    // Whether this server has the rule is not what is tested.
    if (stability !== "friction") return route.continue();
    const error = { code: "friction_unsupported", message: "friction is not asked of it yet" };
    await route.fulfill({ status: 422, json: { error } });
  });
  await ops.open();
  await page.keyboard.press("2");
  await ops.at("overlay-reachability").check();
  await expect(ops.at("reach-state")).toHaveText("For this stance, regular");
  await ops.at("plan-options").click();
  await ops.at("preference-conservative").check();
  await expect(ops.at("reach-state")).toHaveText("For this stance, conservative");
  await expect(ops.at("plan-options-chosen")).toHaveText("conservative");
  watch.provoke(/422/);
  await ops.at("preference-friction").check();
  await expect(ops.at("reach-state")).toHaveText("friction is not asked of it yet");
  expect(asked).toEqual(["regular", "conservative", "friction"]);
});

const drawn = (ops: Console) => ops.hook((hook) => hook.regions().map(({ key }) => key));
