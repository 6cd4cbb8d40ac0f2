// One wheel by hand: turned about where it touches the ground, and rolled in the air.

import { type Console, expect, test } from "./support/console";

interface Frame {
  contact_points_m: Record<string, [number, number, number]>;
  operation: { mode: string; wheels: Record<string, { heading_rad: number; brake: boolean }> };
  state: { wheels_rad?: Record<string, number> };
}

async function frame(ops: Console): Promise<Frame> {
  const rover = await ops.server.get<{ latest: { frame: Frame } }>("rover");
  return rover.latest.frame;
}

/** Stages, arms and sends what a button stages, and waits until the rover has done `n` in all. */
async function byHand(ops: Console, button: string, n: number): Promise<void> {
  await ops.at(button).click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  const done = async () => {
    const { commands } = await ops.server.get<{ commands: { state: string }[] }>("commands");
    return commands.filter((command) => command.state === "done").length;
  };
  await expect.poll(done, { timeout: 60_000 }).toBe(n);
}

test("a standing wheel is turned about its contact, a lifted one is rolled", async ({
  ops,
  server,
}) => {
  test.setTimeout(200_000);
  await ops.open();
  await server.setDelay(0.1);
  await ops.page.keyboard.press("1");
  await ops.at("tab-hand").click();
  const before = await frame(ops);
  await ops.at("turn-angle").fill("15");
  await byHand(ops, "hand-turn", 1);
  const turned = async () => {
    const wheel = (await frame(ops)).operation.wheels.leg1!;
    return ((wheel.heading_rad - before.operation.wheels.leg1!.heading_rad) * 180) / Math.PI;
  };
  await expect.poll(turned).toBeCloseTo(15, 0);
  const [x, y] = (await frame(ops)).contact_points_m.leg1!;
  const [x0, y0] = before.contact_points_m.leg1!;
  expect(Math.hypot(x - x0, y - y0), "it stands where it stood").toBeLessThan(0.01);

  await ops.at("line-up").fill("0.15");
  await byHand(ops, "hand-line", 2);
  await ops.at("hand-part-wheels").check();
  await ops.at("operating-driving").check();
  await byHand(ops, "hand-mode", 3);
  await expect(ops.at("operating-now")).toHaveText("reported: driving");
  await ops.at("wheels-all").uncheck();
  await expect(ops.at("hand-roll"), "no wheel is chosen").toBeDisabled();
  await ops.at("wheel-leg1").check();
  await byHand(ops, "hand-release", 4);
  await expect(ops.at("brake-leg1")).toHaveText("off");
  await ops.at("roll-angle").fill("-90");
  await byHand(ops, "hand-roll", 5);
  const rolled = async () => (await frame(ops)).state.wheels_rad?.leg1 ?? 0;
  await expect.poll(rolled).toBeCloseTo(-Math.PI / 2, 2);
});
