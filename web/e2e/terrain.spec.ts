// A new map: generated, or from an uploaded file; the rover stands on it and can step.

import { sharedData } from "./support/files";
import { type Console, expect, test } from "./support/console";

test("a generated map replaces the one before", async ({ ops }) => {
  await ops.open();
  await ops.at("import-open").click();
  await ops.at("import-recipe").check();
  await ops.at("import-recipe-name").selectOption("smooth_mare");
  await ops.at("import-width").fill("20");
  await ops.at("import-seed").fill("11");
  await ops.at("import-start").click();
  await expect(ops.at("import")).toHaveCount(0);
  await expect(ops.at("map-name")).toContainText("seed 11");
  await expect(ops.at("map-synthetic")).toBeVisible();
  expect(await reachesTo(ops, 9.5)).toBe(true);
  expect(await reachesTo(ops, 11)).toBe(false);
  await ops.at("overlay-traversability").check();
  await expect(ops.page.getByText("caution")).toBeVisible();
});

test("a field that says nothing usable keeps the import from starting", async ({ ops, watch }) => {
  await ops.open();
  await ops.at("import-open").click();
  await expect(ops.at("import-start")).toBeDisabled();
  await expect(ops.at("import-says")).toHaveText("Choose a file.");
  await ops.at("import-recipe").check();
  await ops.at("import-seed").fill("x");
  await expect(ops.at("import-says")).toContainText("seed");
  await ops.at("import-seed").fill("3");
  watch.provoke(/422/);
  await ops.at("import-width").fill("0.2");
  await ops.at("import-start").click();
  await expect(ops.at("import-failure")).not.toBeEmpty();
  await ops.page.keyboard.press("Escape");
  await expect(ops.at("import")).toHaveCount(0);
});

const FRACTAL = "klampt_terrains/fractal_terrain_1.off";
const fractal = sharedData("an uploaded mesh becomes the map and carries a step", FRACTAL);
if (fractal !== null) {
  test("an uploaded mesh becomes the map and carries a step", async ({ ops, server }) => {
    await ops.open();
    await server.setDelay(0.3);
    await upload(ops, fractal);
    await ops.at("import-start").click();
    await expect(ops.at("import")).toHaveCount(0);
    await expect(ops.at("map-name")).toContainText("fractal_terrain_1.off");
    await expect(ops.at("map-synthetic")).toHaveCount(0);
    await planBeside(ops);
  });
}

const MARS = "gale_hirise_1m/missionDEM.tif";
const mars = sharedData("a part of a Mars map gets synthetic detail and carries a plan", MARS);
if (mars !== null) {
  test("a part of a Mars map gets synthetic detail and carries a plan", async ({ ops, server }) => {
    await ops.open();
    await server.setDelay(0.3);
    await upload(ops, mars);
    await ops.at("import-crop").check();
    await ops.at("import-crop-width").fill("60");
    await ops.at("import-detail").check();
    await ops.at("import-detail-resolution").fill("0.1");
    await ops.at("import-start").click();
    await expect(ops.at("import")).toHaveCount(0, { timeout: 60_000 });
    await expect(ops.at("map-name")).toContainText("missionDEM.tif");
    await expect(ops.at("map-synthetic")).toBeVisible();
    await planBeside(ops);
  });
}

async function upload(ops: Console, path: string): Promise<void> {
  await ops.at("import-open").click();
  await ops.at("import-file").check();
  await ops.at("import-upload").setInputFiles(path);
  await expect(ops.at("import-file-name")).toHaveValue(path.split("/").at(-1)!);
}

/** A reachable place near leg 6 is picked and a step to it is found. */
async function planBeside(ops: Console): Promise<void> {
  // The rover is set down on the new map one delay after the map itself is there.
  await expect.poll(() => ops.gapBelow("leg6")).toBeLessThan(0.1);
  await ops.page.keyboard.press("6");
  await ops.at("overlay-reachability").check();
  await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready");
  await ops.clickGround(await ops.groundBeside("leg6", 0.15, -0.1));
  await expect(ops.at("pick")).toContainText("Pick");
  await ops.planWithEnter();
}

function reachesTo(ops: Console, x_m: number): Promise<boolean> {
  return ops.page.evaluate((x) => !Number.isNaN(window.__footfall!.height(x, 0)), x_m);
}
