// Steps that shift the body first, are backed out, or cannot be: as the real server answers them.

import type { RoverAnswer, Vec3 } from "../src/api/types";
import { distance, expect, test } from "./support/console";
import type { GroundServer } from "./support/server";

test("a conservative step shifts the body first and is executed to its end", async ({
  ops,
  page,
  server,
}) => {
  test.setTimeout(170_000);
  await server.setDelay(0.5);
  await ops.open();
  await ops.at("plan-options").click();
  await ops.at("preference-conservative").check();
  await expect(ops.at("plan-options-chosen")).toHaveText("conservative");
  await ops.at("plan-options").click();
  await ops.pickBeside("leg5", 0.2, -0.25);
  const plan = await ops.planWithEnter();
  const phases = plan.commands.map((c) => c.phase);
  expect(phases).toEqual(["shift", "lift", "transit", "drop", "preload"]);
  await expect(ops.at("command-0")).toContainText("Shift the body");

  const before = await base(server);
  const wheel = (await ops.wheel("leg1"))!;
  await test.step("the body goes over its feet, and is dead-reckoned on its way", async () => {
    await ops.at("stage-0").click();
    await ops.release("0");
    await expect(ops.at("predicted")).toBeVisible();
    await expect(ops.at("state-0")).toHaveText("executing");
    await ops.expectDone("0");
    await expect(ops.at("predicted")).toHaveCount(0);
    expect(distance(await base(server), before)).toBeGreaterThan(0.05);
    await ops.expectWheelAt("leg1", wheel);
  });
  for (const index of phases.keys()) if (index > 0) await ops.execute(index);
  await expect(ops.at("step")).toHaveAttribute("data-stage", "done");
  await ops.expectWheelAt("leg5", plan.footfall!.wheel.position_m);
  await expect(page.getByText("Stance or map have changed")).toHaveCount(0);
});

test("a step that was begun is backed out, last part first", async ({ ops, server }) => {
  test.setTimeout(170_000);
  await server.setDelay(0.3);
  await ops.open();
  const before = (await ops.wheel("leg1"))!;
  await ops.pickBeside("leg1", 0.25, -0.3);
  const plan = await ops.planWithEnter();
  await expect(ops.at("way-back")).toHaveCount(0);
  await ops.execute(0);
  await ops.execute(1);

  await ops.at("back-out").click();
  await expect(ops.at("command-back-2")).toContainText("Move leg 1 back");
  await expect(ops.at("stage-2")).toBeDisabled();
  await ops.release("back-2");
  await expect(ops.at("stage-back-3")).toBeDisabled();
  await ops.expectDone("back-2");
  await expect(ops.at("step")).toContainText("Put leg 1 back");
  await ops.at("stage-back-3").click();
  await ops.release("back-3");
  await ops.expectDone("back-3");
  await expect(ops.at("step")).toHaveAttribute("data-stage", "done");
  await expect(ops.at("step")).toContainText("backed out");
  await ops.expectWheelAt("leg1", before);

  await test.step("and planned anew", async () => {
    const anew = await ops.planWithEnter();
    expect(anew.id).not.toBe(plan.id);
    await expect(ops.at("stage-0")).toBeEnabled();
  });
});

test("a step that cannot be says what is missing and where it could be", async ({ ops, page }) => {
  await ops.open();
  await ops.pickBeside("leg1", 1.3, 0);
  await page.keyboard.press("Enter");
  await expect(ops.at("plan-outcome")).toHaveText("Unreachable");
  await expect(ops.at("plan-constraint")).toContainText(/Out of reach.*0\.\d\d m/);
  await ops.at("use-nearest").click();
  await ops.planWithEnter();

  await ops.at("plan-drop").click();
  await ops.at("plan-options").click();
  await ops.at("preference-conservative").check();
  await ops.at("option-shift").uncheck();
  await ops.at("plan-options").click();
  await ops.pickBeside("leg4", -0.1, 0);
  await page.keyboard.press("Enter");
  await expect(ops.at("plan-outcome")).toHaveText("Unstable");
  await expect(ops.at("plan-constraint")).toContainText(/stability margin.*\d\.\d c?m/);
});

async function base(server: GroundServer): Promise<Vec3> {
  const { latest } = await server.get<RoverAnswer>("rover");
  return latest!.frame.state.base.position_m as Vec3;
}
