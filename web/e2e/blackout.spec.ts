// The link is dark for a while: the console says so, with what is known of why, and goes on by itself.

import { type Console, expect, test } from "./support/console";

/** How long it is dark (s): 60 with FOOTFALL_FULL. */
const DARK_S = process.env.FOOTFALL_FULL ? 60 : 12;

/** Outages of both directions, from now on. */
function dark(traffic: "hold" | "lose"): object {
  const at = (seconds: number) => new Date(Date.now() + seconds * 1000).toISOString();
  const outages = [{ begin: at(0), end: at(DARK_S), traffic }];
  return { up: { outages }, down: { outages } };
}

async function expectDark(ops: Console): Promise<void> {
  const silence = ops.at("silence");
  await expect(silence).toContainText(/No telemetry for \d+\.\d s/);
  await expect(silence).toContainText(/was true on board \d+\.\d s ago/);
  await expect(silence).toContainText(/in an outage until \d\d:\d\d:\d\d UTC, as set/);
  await expect(ops.at("age")).toHaveClass(/stale/);
}

async function expectLight(ops: Console): Promise<void> {
  await expect(ops.at("silence")).toHaveCount(0, { timeout: (DARK_S + 15) * 1000 });
  await expect(ops.at("age")).not.toHaveClass(/stale/);
}

test("a command waits for the end of a blackout, an E-stop is repeated until it comes", async ({
  ops,
  server,
}) => {
  test.setTimeout(120_000 + 3000 * DARK_S);
  await ops.open();
  const before = (await ops.wheel("leg4"))!;
  await ops.page.keyboard.press("4");
  await ops.at("tab-hand").click();
  await ops.at("line-up").fill("0.10");
  await ops.at("hand-line").click();
  await ops.at("hand-arm").click();
  await expect(ops.at("take-back")).toBeFocused();

  await server.setDelay(0.2, dark("hold"));
  await expectDark(ops);
  await expect(ops.at("silence")).toContainText(/Commands and an E-stop wait until/);
  await ops.at("send-hand").click();
  // Nothing is said of the rover that it has not said.
  await expect.poll(() => states(ops)).toEqual(["sent"]);
  await expect(ops.at("step"), "after the blackout").toContainText(/arrives in ([3-9]|\d\d)\.\d s/);
  await expect(ops.at("silence")).toHaveCount(1);
  await expectLight(ops);
  await ops.at("tab-log").click();
  await expect(ops.at("command-log").locator("[data-state=done]")).toHaveCount(1, {
    timeout: 40_000,
  });
  await ops.expectWheelAt("leg4", [before[0], before[1], before[2] + 0.1]);

  await server.setDelay(0.2, dark("lose"));
  await expectDark(ops);
  await expect(ops.at("silence")).toContainText(/are lost; an E-stop is repeated/);
  await ops.at("estop").click();
  await expect(ops.at("estop-note")).toHaveAttribute("data-state", "sent");
  await expectLight(ops);
  await expect(ops.at("estop-note")).toHaveAttribute("data-state", "confirmed");
});

async function states(ops: Console): Promise<string[]> {
  const { commands } = await ops.server.get<{ commands: { state: string }[] }>("commands");
  return commands.map((command) => command.state);
}
