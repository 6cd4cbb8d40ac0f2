// The link: long delays are shown as they are, a lost server is told and found again.

import { expect, test } from "./support/console";

test("a wheel is raised by hand under a delay, with both clocks of the command", async ({
  ops,
  server,
}) => {
  await ops.open();
  await server.setDelay(0.8);
  await ops.page.keyboard.press("4");
  await ops.at("tab-hand").click();
  const before = (await ops.wheel("leg4"))!;
  await ops.at("line-up").fill("0.10");
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await expect(ops.at("take-back")).toBeFocused();
  await ops.at("send-hand").click();
  await expect(ops.at("step")).toContainText("arrives in");
  await expect(ops.at("step")).toContainText("earliest ack in");
  await expect(ops.at("step")).toHaveAttribute("data-stage", "executing");
  await ops.at("tab-log").click();
  await expect(ops.at("command-log").locator("[data-state=done]")).toHaveCount(1, {
    timeout: 40_000,
  });
  await ops.expectWheelAt("leg4", [before[0], before[1], before[2] + 0.1]);
  await ops.at("tab-telemetry").click();
  await expect(ops.page.getByText("lifted")).toBeVisible();
});

test("an armed command can be taken back, and a stop ends what runs", async ({ ops, server }) => {
  await ops.open();
  await server.setDelay(0.2);
  await ops.page.keyboard.press("5");
  await ops.at("tab-hand").click();
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await expect(ops.at("take-back")).toBeFocused();
  await ops.page.keyboard.press("Enter");
  await expect(ops.at("send-hand")).toHaveCount(0);

  const step = ops.at("step");
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await expect(step).toHaveAttribute("data-stage", "executing");
  await expect(step).toHaveAttribute("data-stage", "pick");

  // A long swing of the lifted leg, so that there is time to stop it.
  await ops.at("joint-0").fill("40");
  await ops.at("hand-joints").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await expect(step).toHaveAttribute("data-stage", "executing");
  await ops.at("hand-stop").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await ops.at("tab-log").click();
  const log = ops.at("command-log");
  await expect(log.locator("[data-state=cancelled]")).toHaveCount(1);
  await expect(log.locator("[data-state=aborted]")).toHaveCount(1);
  await expect(log.locator("[data-state=done]")).toHaveCount(2);
});

test("an E-stop under a long delay says when it takes effect", async ({ ops, server }) => {
  await ops.open();
  await server.setDelay(2);
  await expect(ops.at("delays")).toHaveText("2.0 s2.0 s");
  await ops.at("estop").click();
  const note = ops.at("estop-note");
  await expect(note).toHaveAttribute("data-state", "sent");
  await expect(note).toContainText("takes effect in");
  await expect(note).toContainText("Until then the rover does what it was told before");
  await expect(note).toContainText("waiting for the rover's word");
  await expect(note).toHaveAttribute("data-state", "confirmed");
});

test("a server that goes away is told at once and found again", async ({ ops, server, watch }) => {
  await ops.open();
  await ops.page.keyboard.press("2");
  watch.provoke(/WebSocket|ERR_CONNECTION|Failed to load|request: /);
  await server.stop();
  await expect(ops.at("banner")).toContainText("nothing can be sent");
  await expect(ops.at("plan")).toBeDisabled();
  await expect(ops.at("plan")).toHaveAttribute("title", /No connection/);
  await expect(ops.at("age")).toHaveClass(/stale/);
  await ops.at("estop").click();
  await expect(ops.at("estop-note")).toContainText("E-stop was not sent");

  await ops.page.getByRole("button", { name: "Try now" }).click();
  await server.start();
  await expect(ops.at("banner")).toHaveCount(0);
  watch.provoke();
  await expect(ops.at("age")).not.toHaveClass(/stale/);
  await ops.at("overlay-reachability").check();
  await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready");
});
