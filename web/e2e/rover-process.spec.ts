// A rover that is a process of its own: either end dies, or is silent, and the console shows the truth.

import { type Console, expect, test as base } from "./support/console";
import { RoverProcess } from "./support/rover";
import { GroundServer } from "./support/server";

/** How long the rover is silent (s): 60 with FOOTFALL_FULL. */
const BLACKOUT_S = process.env.FOOTFALL_FULL ? 60 : 6;

const test = base.extend<{ rover: RoverProcess }>({
  // Playwright reads the names of the parameters, so that there must be a pattern.
  // eslint-disable-next-line no-empty-pattern
  rover: async ({}, use) => {
    const rover = new RoverProcess();
    await rover.start();
    await use(rover);
    await rover.dispose();
  },
  server: async ({ rover }, use) => {
    const server = new GroundServer(["--rover", rover.url]);
    await server.start();
    await use(server);
    await server.dispose();
  },
});

/** Raises the wheel of leg 4 by hand, which takes some seconds. */
async function raise(ops: Console): Promise<void> {
  await ops.page.keyboard.press("4");
  await ops.at("tab-hand").click();
  await ops.at("line-up").fill("0.20");
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await expect(ops.at("step")).toHaveAttribute("data-stage", "executing");
}

test("the rover's process dies in the middle of a command", async ({ ops, server, rover }) => {
  await ops.open();
  await server.setDelay(0.2);
  await expect(ops.at("rover-banner")).toHaveCount(0);
  await raise(ops);
  await rover.kill();
  const banner = ops.at("rover-banner");
  await expect(banner).toHaveAttribute("data-state", "reconnecting");
  await expect(banner).toContainText("Rover link down, reconnecting");
  await expect(banner).toContainText(/Last heard \d/);
  await expect(ops.at("link")).toContainText("No rover");
  await expect(ops.at("age")).toHaveClass(/stale/);
  await expect(ops.at("hand-line")).toBeDisabled();
  await expect(ops.at("hand-line")).toHaveAttribute("title", /Rover link down/);

  await rover.start();
  await expect(banner).toHaveCount(0);
  await expect(ops.at("age")).not.toHaveClass(/stale/);
  await ops.at("tab-log").click();
  await expect(ops.at("command-log").locator("[data-state=aborted]")).toHaveCount(1);
  const { commands } = await server.get<{ commands: { state: string; why: string }[] }>("commands");
  expect(commands.map((command) => command.state)).toEqual(["aborted"]);
  expect(commands[0]!.why).toContain("process ended");
});

test("the server dies in the middle of a command, the rover goes on", async ({
  ops,
  server,
  watch,
}) => {
  await ops.open();
  await server.setDelay(0.2);
  const before = (await ops.wheel("leg4"))!;
  await raise(ops);
  watch.provoke(/WebSocket|ERR_CONNECTION|Failed to load|request: /);
  await server.stop();
  await expect(ops.at("banner")).toContainText("nothing can be sent");
  await server.start();
  await expect(ops.at("banner")).toHaveCount(0, { timeout: 40_000 });
  watch.provoke();
  await ops.at("tab-log").click();
  await expect(ops.at("command-log").locator("[data-state=done]")).toHaveCount(1, {
    timeout: 40_000,
  });
  await ops.expectWheelAt("leg4", [before[0], before[1], before[2] + 0.2]);
});

test("the rover is silent for a while, and nobody has told", async ({ ops, server, rover }) => {
  test.setTimeout(120_000 + BLACKOUT_S * 1000);
  await ops.open();
  await server.setDelay(0.2);
  rover.freeze(true);
  const banner = ops.at("rover-banner");
  await expect(banner).toContainText("nothing was heard for");
  await ops.page.waitForTimeout(BLACKOUT_S * 1000);
  await expect(banner).toContainText(/Last heard \d+(\.\d+)? s ago/);
  // An E-stop is taken all the same, and waits.
  await ops.at("estop").click();
  await expect(ops.at("estop-note")).toHaveAttribute("data-state", "sent");
  rover.freeze(false);
  await expect(ops.at("estop-note")).toHaveAttribute("data-state", "confirmed");
  await expect(banner).toHaveCount(0);
  await expect(ops.at("age")).not.toHaveClass(/stale/);
});
