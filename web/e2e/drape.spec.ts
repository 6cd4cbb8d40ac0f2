// What is laid over the ground: the picture of the cameras, an imported raster, and the map as a file.

import type { TerrainVersions } from "../src/api/types";
import { expect, test } from "./support/console";

test("the picture of the cameras and an imported raster lie over the ground", async ({
  ops,
  page,
  server,
  watch,
}) => {
  test.setTimeout(300_000);
  await server.setDelay(0.05);
  await ops.open();
  const at = (testId: string) => ops.at(testId);

  watch.provoke(/404/);
  await at("overlay-picture").check();
  await expect(at("picture")).toHaveAttribute("data-state", "failed", { timeout: 30_000 });
  await expect(at("picture")).toContainText("no image of a camera");

  await page.keyboard.press("m");
  for (const pair of ["nav1", "haz1"]) await at(`pair-${pair}`).check();
  await at("wishes").click();
  await at("detail-quick").check();
  await at("ask-pairs").click();
  await expect(at("changes")).toBeVisible({ timeout: 120_000 });
  await at("overlay-picture").check();
  await expect(at("picture")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
  await expect(at("picture")).toContainText("Left images of 2 pairs");
  await expect(at("picture")).toContainText("NavCam 1");

  const { current } = (await (
    await page.request.get("/api/v1/terrain/versions")
  ).json()) as TerrainVersions;
  await at("export-format").selectOption("ply");
  await at("export-error").selectOption("0.05");
  const href = await at("export").getAttribute("href");
  expect(href).toBe(`/api/v1/terrain/${current}/export?format=ply&error_m=0.05`);
  const mesh = await (await page.request.get(href!)).body();
  expect(mesh.subarray(0, 4).toString()).toBe("ply\n");
  const whole = await page.request.get(`/api/v1/terrain/${current}/export?format=ply`);
  expect(mesh.length).toBeLessThan((await whole.body()).length / 2);

  // The exported picture is a raster of this ground.
  const tif = await page.request.get(`/api/v1/terrain/${current}/export?format=texture`);
  expect(tif.status()).toBe(200);
  const buffer = await tif.body();
  await at("rasters-open").click();
  await at("raster-file").setInputFiles({ name: "seen.tif", mimeType: "image/tiff", buffer });
  await expect(at("raster")).toHaveValue(/.+/);
  await expect(at("raster-opacity")).toBeVisible();
  await at("raster-opacity").fill("0.4");
  watch.provoke(/422/);
  const junk = Buffer.from("II*\0no more");
  await at("raster-file").setInputFiles({ name: "junk.tif", mimeType: "image/tiff", buffer: junk });
  await expect(at("raster-failure")).toContainText("cannot be read");
  await at("raster-remove").click();
  await expect(at("raster")).toHaveCount(0);
});
