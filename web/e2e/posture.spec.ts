// The posture adviser's offer becomes a plan; what a lost leg would leave; cells that were planned to; and
// which of it a replay can tell.

import type { LogList } from "../src/api/types";
import { distance, expect, test } from "./support/console";

test("postures, rehearsal and planned cells, live and in a replay", async ({
  ops,
  page,
  server,
}) => {
  test.setTimeout(240_000);
  await server.setDelay(0.2);
  await ops.open();

  await test.step("the adviser offers a posture, shown as a ghost", async () => {
    await page.keyboard.press("2");
    await expect(ops.at("posture-without")).toHaveText(/^\d\.\d\d m margin without it$/);
    await ops.at("posture").click();
    await ops.at("posture-conservative").fill("0.2");
    await ops.at("posture-ask").click();
    await expect(ops.at("posture-answer")).toHaveAttribute("data-outcome", "found", {
      timeout: 90_000,
    });
    await ops.at("proposal-0").hover();
    await expect.poll(() => ops.hook((hook) => hook.ghost())).not.toBeNull();
    const ghost = (await ops.hook((hook) => hook.ghost()))!;
    expect(distance(ghost, (await ops.wheel("leg2"))!)).toBeGreaterThan(0.1);
  });

  await test.step("one click makes it the plan, which is staged like any other", async () => {
    await ops.at("take-up-0").click();
    await expect(ops.at("plan-outcome")).toHaveText("Posture");
    await expect(ops.at("findings")).toContainText(/All \d+ checks hold/);
    await ops.at("preview-scrub").fill("200");
    const end = (await ops.hook((hook) => hook.ghost()))!;
    expect(distance(end, (await ops.wheel("leg2"))!)).toBeGreaterThan(0.1);
    await ops.at("stage-0").click();
    await expect(ops.at("command-0")).toHaveAttribute("data-state", "staged");
    await expect(ops.at("arm-0")).toBeEnabled();
    await ops.at("cancel-0").click();
    await ops.at("plan-drop").click();
  });

  await test.step("the loss and settlement of every leg is rehearsed", async () => {
    await ops.at("tab-stability").click();
    await ops.at("rehearse").click();
    await expect(ops.at("rehearsal")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    for (let leg = 1; leg <= 6; leg++) {
      const row = ops.at(`rehearsal-leg${leg}`);
      await expect(row).toContainText(/\d\.\d\d m/);
      await expect(row.getByRole("img")).toHaveCount(2);
    }
  });

  await test.step("the energy slice follows the heading", async () => {
    const told = () => ops.at("slice-plot").getAttribute("aria-label");
    await expect(ops.at("slice-plot")).toHaveAttribute("aria-label", /^Rise to tip: \d\.\d\d m/);
    const ahead = await told();
    await ops.at("slice-control").fill("-120");
    await expect(ops.at("slice-heading")).toHaveText("120° to the left");
    await expect.poll(told).not.toBe(ahead);
  });

  await test.step("cells are really planned to, counted and cancelled", async () => {
    await ops.at("overlay-reachability").check();
    await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await ops.at("plan-to-cells").click();
    const count = async () => Number(await ops.at("legend-count-6").textContent());
    await expect.poll(count, { timeout: 60_000 }).toBeGreaterThan(60);
    await ops.at("plannable-cancel").click();
    await expect(ops.at("plan-to-cells")).toBeVisible();
    expect(await count()).toBeGreaterThan(60);
    await ops.clickGround(await ops.groundBeside("leg2", 0.2, 0.2));
    await expect(ops.at("why-not")).toContainText("Leg 2: plannable");
  });

  await test.step("a replay tells the same, but for what is asked of the live rover only", async () => {
    const { logs } = await server.get<LogList>("logs");
    await ops.at("mode-menu").click();
    await ops.at(`replay-${logs[0]!.id}`).click();
    await expect(ops.at("mode")).toHaveText("REPLAY");
    await expect(ops.at("opening")).toHaveCount(0);
    await ops.at("replay-toggle").click();
    await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await expect(page.getByText("for the live rover only")).toBeVisible();
    await ops.at("rehearse").click();
    await expect(ops.at("rehearsal")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await expect(ops.at("slice-plot")).toBeVisible();
    await ops.at("tab-step").click();
    await expect(ops.at("posture-without")).toHaveText(/margin without it$/);
  });
});
