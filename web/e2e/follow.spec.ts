// The plan that follows the pointer: drawn where the leg can step, with the reason where it cannot,
// gone with the pointer, and nothing at all once it is switched off.

import type { PlanRequest } from "../src/api/types";
import { type Console, distance, expect, test } from "./support/console";

const AT_ONCE = /\/api\/v1\/analysis\/plan$/;

test("the plan follows the pointer and says why there is none", async ({ ops, page }) => {
  // How long a search may take here depends on the machine, and is not what is tested.
  await page.route(AT_ONCE, async (route) => {
    const request = route.request().postDataJSON() as PlanRequest;
    await route.continue({ postData: { ...request, deadline_s: 60 } });
  });
  await ops.open();
  const note = ops.at("follow");
  await page.keyboard.press("1");

  await test.step("over ground within reach the step is drawn to its end", async () => {
    const place = await ops.groundBeside("leg1", 0.25, -0.3);
    await pointAt(ops, place);
    await expect(note).toHaveAttribute("data-outcome", "found");
    await expect(note).toContainText("Leg 1 can step here");
    await expect(note).toContainText(" ms");
    const ghost = await page.evaluate(() => window.__footfall!.ghost());
    expect(distance([ghost![0], ghost![1], place[2]], place)).toBeLessThan(0.2);
  });

  await test.step("beyond it the constraint is named", async () => {
    await pointAt(ops, await ops.groundBeside("leg1", 1.3, 0));
    await expect(note).toHaveAttribute("data-outcome", "unreachable");
    await expect(note).toContainText(/Leg 1: .*out of reach/);
    expect(await page.evaluate(() => window.__footfall!.ghost())).toBeNull();
  });

  await test.step("it is gone when the pointer leaves the ground", async () => {
    await page.mouse.move(5, 5);
    await expect(note).toHaveCount(0);
  });

  await test.step("a click picks, and what is planned is drawn alone", async () => {
    await ops.clickGround(await ops.groundBeside("leg1", 0.25, -0.3));
    await expect(ops.at("pick")).toContainText("Pick");
    await expect(note).toHaveAttribute("data-outcome", "found");
    await ops.planWithEnter();
    await expect(note).toHaveCount(0);
    await ops.at("plan-drop").click();
  });

  await test.step("switched off it asks nothing", async () => {
    await page.keyboard.press("h");
    await expect(ops.at("follow-toggle")).not.toBeChecked();
    let asked = 0;
    page.on("request", (request) => void (AT_ONCE.test(request.url()) && (asked += 1)));
    const cell = page.waitForResponse(/\/cell\?/);
    await pointAt(ops, await ops.groundBeside("leg1", 0.1, -0.2));
    await cell;
    expect(asked).toBe(0);
    await expect(note).toHaveCount(0);
  });
});

async function pointAt(ops: Console, place: [number, number, number]): Promise<void> {
  const at = await ops.page.evaluate((p) => window.__footfall!.project(...p), place);
  const box = (await ops.at("canvas").boundingBox())!;
  await ops.page.mouse.move(box.x + at!.x, box.y + at!.y);
}
