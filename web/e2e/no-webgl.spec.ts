// Without WebGL the console says so, and everything but the picture works: pick, plan, send.

import { expect, test } from "./support/console";

// A launch option belongs to the whole file: this browser can draw nothing in three dimensions.
test.use({
  launchOptions: {
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    chromiumSandbox: false,
    args: ["--disable-gpu", "--disable-software-rasterizer"],
  },
});

test("a browser without WebGL plans and sends by keyboard", async ({ ops, page, server }) => {
  await page.goto(server.url);
  await server.setDelay(0.2);
  await expect(ops.at("no-webgl")).toContainText("WebGL");
  await expect(ops.at("leg-leg1")).toBeVisible();
  await expect(ops.at("age")).not.toHaveClass(/stale/);
  await expect(ops.at("map-name")).toContainText("seed");
  await page.keyboard.press("1");
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowUp");
  await expect(ops.at("pick")).toContainText("Pick");
  await ops.planWithEnter();
  await ops.execute(0);
});
