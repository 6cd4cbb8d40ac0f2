// The whole job with mouse and keyboard: one step is picked, planned, looked at, sent command by
// command and done; the rover is stopped and released; the log of it all is replayed.

import type { LogList, Vec3 } from "../src/api/types";
import { type Console, distance, expect, test } from "./support/console";

test("a step is planned, executed, stopped, released and replayed", async ({
  ops,
  page,
  server,
}) => {
  test.setTimeout(170_000);
  await ops.open();
  const { at } = bound(ops);
  await setDelays(ops, "0.3");

  await page.keyboard.press("1");
  await expect(at("leg-leg1")).toHaveAttribute("aria-pressed", "true");
  await at("overlay-reachability").check();
  await expect(at("reach-state")).toHaveAttribute("data-state", "ready");

  const before = (await ops.wheel("leg1"))!;
  const place = await ops.groundBeside("leg1", 0.25, -0.3);
  await ops.clickGround(place);
  await expect(at("pick")).toContainText("Pick");
  expect(distance(await ops.picked(), place), "the click picks its place").toBeLessThan(0.05);
  await page.mouse.move(700, 30);
  await expect(at("why-not")).toContainText("reachable");

  const plan = await ops.planWithEnter();
  const footfall = plan.footfall!.wheel.position_m;
  await expect(at("findings")).toContainText("checks hold");
  await at("findings").click();
  await expect(at("findings")).toHaveAttribute("aria-expanded", "true");

  await test.step("the preview carries the ghost from the old to the new footfall", async () => {
    const scrub = at("preview-scrub");
    await scrub.focus();
    await page.keyboard.press("End");
    await expect.poll(() => gap(ops, footfall)).toBeLessThan(0.02);
    await page.keyboard.press("Home");
    await expect.poll(() => gap(ops, before)).toBeLessThan(0.02);
    const box = (await scrub.boundingBox())!;
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
    await expect.poll(() => gap(ops, footfall)).toBeGreaterThan(0.05);
    await expect.poll(() => gap(ops, before)).toBeGreaterThan(0.05);
  });

  const phases = plan.commands.map((c) => c.phase);
  expect(phases).toEqual(["lift", "transit", "drop", "preload"]);
  for (const index of phases.keys()) await ops.execute(index);
  await expect(at("step")).toHaveAttribute("data-stage", "done");
  await ops.expectWheelAt("leg1", footfall);

  await test.step("the E-stop key stops, two steps release", async () => {
    await page.keyboard.press("F9");
    await stopAndRelease(ops);
  });
  await test.step("the E-stop button stops, two steps release", async () => {
    await at("estop").click();
    await stopAndRelease(ops);
  });

  await test.step("the log shows the same motion", async () => {
    const { logs } = await server.get<LogList>("logs");
    await at("mode-menu").click();
    await at(`replay-${logs[0]!.id}`).click();
    await expect(at("mode")).toHaveText("REPLAY");
    await expect(at("plan")).toBeDisabled();
    await expect(at("plan")).toHaveAttribute("title", /replay/);
    await at("tab-hand").click();
    await expect(at("hand-stop")).toBeDisabled();
    await expect(at("hand-stop")).toHaveAttribute("title", /replay/);

    await at("replay-scrub").focus();
    await page.keyboard.press("End");
    await page.getByRole("button", { name: "To the beginning" }).click();
    await ops.expectWheelAt("leg1", before);
    await at("replay-scrub").focus();
    await page.keyboard.press("End");
    await ops.expectWheelAt("leg1", footfall);
    await at("tab-log").click();
    await expect(at("command-log").locator("[data-state=done]")).toHaveCount(phases.length);

    await at("back-to-live").click();
    await expect(at("mode")).toHaveText("LIVE");
    await ops.expectWheelAt("leg1", footfall);
    await at("tab-hand").click();
    await expect(at("hand-stop")).toBeEnabled();
  });
});

function bound(ops: Console) {
  return { at: (testId: string) => ops.at(testId) };
}

/** How far the ghost's wheel is from a place (m). */
async function gap(ops: Console, place: Vec3): Promise<number> {
  const ghost = await ops.page.evaluate(() => window.__footfall!.ghost());
  return ghost ? distance(ghost, place) : NaN;
}

/** Both delays through the link's own menu. */
async function setDelays(ops: Console, seconds: string): Promise<void> {
  await ops.at("link").click();
  await ops.at("delay-up").fill(seconds);
  await ops.at("delay-down").fill(seconds);
  await ops.at("delay-apply").click();
  await expect(ops.at("delays")).toHaveText(`${seconds} s${seconds} s`);
  await ops.page.keyboard.press("Escape");
}

async function stopAndRelease(ops: Console): Promise<void> {
  const note = ops.at("estop-note");
  await expect(note).toHaveAttribute("data-state", "confirmed");
  await ops.at("tab-hand").click();
  await expect(ops.at("hand-stop")).toBeDisabled();
  await expect(ops.at("hand-stop")).toHaveAttribute("title", /E-stop/);
  await ops.at("estop-release").click();
  await ops.at("estop-confirm-release").click();
  await expect(note).toHaveCount(0);
  await expect(ops.at("hand-stop")).toBeEnabled();
  await ops.at("tab-step").click();
}
