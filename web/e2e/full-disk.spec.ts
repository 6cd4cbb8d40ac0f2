// The disk of the flight log is full: the console says what is lost and refuses to command, the E-stop passes,
// and all goes on by itself.

import { expect, test as base } from "./support/console";
import { Filler, onSmallDisk, wayToMount } from "./support/disk";
import { GroundServer } from "./support/server";

/** How long it is full (s): 60 with FOOTFALL_FULL. */
const FULL_S = process.env.FOOTFALL_FULL ? 60 : 6;

const way = wayToMount();

const test = base.extend<{ server: GroundServer }>({
  // Playwright reads the names of the parameters, so that there must be a pattern.
  // eslint-disable-next-line no-empty-pattern
  server: async ({}, use) => {
    const server = new GroundServer([], null, (logs) => onSmallDisk(way!, logs));
    await server.start();
    await use(server);
    await server.dispose();
  },
});

test.skip(way === null, "no disk of its own can be given to a process here (unshare, tmpfs)");

test("a full disk is told with what it costs, and all goes on once there is room", async ({
  ops,
  server,
}) => {
  test.setTimeout(120_000 + FULL_S * 1000);
  await ops.open();
  await server.setDelay(0.2);
  const banner = ops.at("log-banner");
  await expect(banner).toHaveCount(0);
  const before = (await ops.wheel("leg4"))!;
  await ops.page.keyboard.press("4");
  await ops.at("tab-hand").click();

  const filler = new Filler(server.pid, server.logs);
  filler.fill();
  await expect(banner).toContainText("the disk is full");
  const lost = async () => Number(await banner.locator(".num").textContent());
  const first = await lost();
  await expect.poll(lost, { message: "what is lost is counted on" }).toBeGreaterThan(first);
  await expect(ops.at("health")).toHaveText("Critical");
  await expect(ops.at("hand-line")).toBeDisabled();
  await expect(ops.at("hand-line")).toHaveAttribute("title", /flight log/);
  const [status, refusal] = await server.ask("POST", "commands", {
    body: { type: "hold" },
  });
  expect(status).toBe(503);
  expect(refusal).toMatchObject({ error: { code: "log_unavailable" } });
  // The rover is seen as before, and can be stopped.
  await ops.page.waitForTimeout(FULL_S * 1000);
  await expect(ops.at("age")).not.toHaveClass(/stale/);
  await ops.at("estop").click();
  await expect(ops.at("estop-note")).toHaveAttribute("data-state", "confirmed");
  await ops.at("estop-release").click();
  await ops.at("estop-confirm-release").click();
  await expect(ops.at("estop-note")).toHaveCount(0);
  await ops.at("tab-log").click();
  const words = ops.at("event-log").getByText(/are not in the log/);
  expect(await words.count(), "told in few words").toBeLessThan(12 + 2 * FULL_S);

  filler.remove();
  await expect(banner).toHaveCount(0, { timeout: 5000 });
  const missing = (await server.get<{ flight_log: { dropped: number } }>("link")).flight_log;
  expect(missing.dropped).toBeGreaterThan(FULL_S * 10);
  await ops.at("health").click();
  await expect(ops.page.getByText(/\d+ messages of this session are not in/)).toBeVisible();
  await ops.page.keyboard.press("Escape");

  await ops.at("tab-hand").click();
  await ops.at("line-up").fill("0.10");
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await ops.at("tab-log").click();
  await expect(ops.at("command-log").locator("[data-state=done]")).toHaveCount(1, {
    timeout: 40_000,
  });
  await ops.expectWheelAt("leg4", [before[0], before[1], before[2] + 0.1]);
});
