// The posture adviser's offer becomes a plan; what a lost leg would leave; cells that were planned to; and
// which of it a replay can tell.

import { readReachGrid } from "../src/api/tiles";
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
    const cells = async () => {
      const answer = await fetch(`${server.url}/api/v1/rover/reachability/leg2`);
      const { classes, header } = readReachGrid(await answer.arrayBuffer());
      return { header, planned: [...classes.keys()].filter((cell) => classes[cell] === 6) };
    };
    await expect.poll(async () => (await cells()).planned.length - (await count())).toBe(0);
    const { header, planned } = await cells();
    expect(planned.length).toBeGreaterThan(60);
    // One cell speaks for its square of 10 cm.
    const side = Math.round(0.1 / header.resolution_m);
    const square = (cell: number) => {
      const [col, row] = [cell % header.size[0], Math.floor(cell / header.size[0])];
      return `${Math.floor(col / side)} ${Math.floor(row / side)}`;
    };
    expect(new Set(planned.map(square)).size).toBe(planned.length);
  });

  await test.step("a replay tells the same, but for what is asked of the live rover only", async () => {
    const { logs } = await server.get<LogList>("logs");
    await ops.at("mode-menu").click();
    await ops.at(`replay-${logs[0]!.id}`).click();
    await expect(ops.at("mode")).toHaveText("REPLAY");
    await expect(ops.at("opening")).toHaveCount(0);
    await ops.at("replay-toggle").click();
    // At its beginning the log has no telemetry yet.
    await ops.at("replay-scrub").focus();
    await page.keyboard.press("End");
    await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await expect(page.getByText("for the live rover only")).toBeVisible();
    await ops.at("rehearse").click();
    await expect(ops.at("rehearsal")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await expect(ops.at("slice-plot")).toBeVisible();
    await ops.at("tab-step").click();
    await expect(ops.at("posture-without")).toHaveText(/margin without it$/);
  });
});
