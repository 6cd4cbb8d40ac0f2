// The console of commanding: who may command, a second person's word, sequences and what they wait for, single
// wheels by hand, outcomes that nobody knows, and the link's presets.

import type { Browser } from "@playwright/test";

import { type Console, Console as Ops, expect, test } from "./support/console";
import { configWith, GroundServer } from "./support/server";

/** A console of its own, as of another person: another browser with another name. */
async function another(browser: Browser, server: GroundServer, name: string): Promise<Console> {
  // A small window: two pictures at once are much to draw in software.
  const context = await browser.newContext({ viewport: { width: 900, height: 600 } });
  const ops = new Ops(await context.newPage(), server);
  await ops.page.goto(`${server.url}/?quality=low`);
  await expect(ops.at("leg-leg1")).toBeVisible({ timeout: 60_000 });
  await called(ops, name);
  return ops;
}

/** Gives a console's operator a name. */
async function called(ops: Console, name: string): Promise<void> {
  await ops.at("authority").click();
  await ops.at("operator-name").fill(name);
  await ops.at("operator-save").click();
  await expect(ops.at("operator-save")).toBeDisabled();
  await ops.page.keyboard.press("Escape");
}

async function byHand(ops: Console, part: "leg" | "wheels" | "body" | "sequence"): Promise<void> {
  await ops.at("tab-hand").click();
  await ops.at(`hand-part-${part}`).check();
}

async function stageMode(ops: Console, mode: "safe" | "ready" | "driving"): Promise<void> {
  await byHand(ops, "wheels");
  await ops.at(`operating-${mode}`).check();
  await ops.at("hand-mode").click();
  await expect(ops.at("hand-arm")).toBeVisible();
}

test("one console commands, the other sees why not, asks, is given it, and takes it over", async ({
  ops,
  server,
  browser,
}) => {
  test.setTimeout(200_000);
  await ops.open();
  await server.setDelay(0.1);
  await called(ops, "ada");
  const bob = await another(browser, server, "bob");
  await expect(ops.at("authority-word")).toHaveText("Nobody commands");

  // Arming takes it where nobody has it: the main path is no longer than before.
  await stageMode(ops, "driving");
  await ops.at("hand-arm").click();
  await expect(ops.at("authority-word")).toHaveText("You command");
  await expect(bob.at("authority-word")).toHaveText("ada commands");
  await ops.at("take-back").click();

  // Others may stage, and see why they cannot arm.
  await stageMode(bob, "safe");
  await expect(bob.at("hand-arm")).toBeDisabled();
  await expect(bob.at("hand-arm")).toHaveAttribute("title", /ada has the authority/);
  await expect(bob.at("step")).toContainText("ada has the authority");

  // Asked for and handed over.
  await bob.at("authority").click();
  await expect(bob.at("lease-left")).toBeVisible();
  await bob.at("authority-ask").click();
  await expect(bob.at("authority-asked")).toContainText("ada sees it");
  await expect(ops.at("authority-word")).toHaveText("bob asks");
  await ops.at("asked-hand-over").click();
  await expect(bob.at("authority-word")).toHaveText("You command");
  await expect(ops.at("authority-word")).toHaveText("bob commands");
  await bob.page.keyboard.press("Escape");
  await bob.at("hand-arm").click();
  await expect(bob.at("send-hand")).toBeVisible();

  // Taken over in two steps: what bob had armed is staged again.
  await ops.at("authority").click();
  await ops.at("authority-take-over").click();
  await ops.at("authority-take-over-sure").click();
  await expect(ops.at("authority-word")).toHaveText("You command");
  await expect(bob.at("send-hand")).toHaveCount(0);
  await expect(bob.at("hand-arm")).toBeDisabled();

  // The E-stop is anybody's.
  await bob.at("estop").click();
  await expect(ops.at("estop-note")).toBeVisible();

  // Given up, and gone where the console of its holder is closed.
  await ops.at("authority-release").click();
  await expect(bob.at("authority-word")).toHaveText("Nobody commands");
  await ops.at("authority-take").click();
  await expect(bob.at("authority-word")).toHaveText("ada commands");
  await bob.page.context().close();
});

test.describe("with a second person for brakes and sequences", () => {
  test.use({
    // Playwright reads the names of the parameters, so that there must be a pattern.
    // eslint-disable-next-line no-empty-pattern
    server: async ({}, use) => {
      const config = configWith({
        two_persons: '"wheel_brake sequence"',
        authority_lease_s: "6.0",
      });
      const server = new GroundServer([], config);
      await server.start();
      await use(server);
      await server.dispose();
    },
  });

  test("who approves is another, in their own console; the author sees who", async ({
    ops,
    server,
    browser,
  }) => {
    test.setTimeout(200_000);
    await ops.open();
    await server.setDelay(0.1);
    await called(ops, "ada");
    const bob = await another(browser, server, "bob");
    await byHand(ops, "wheels");
    await ops.at("hand-brake").click();
    await expect(ops.at("approval")).toHaveText("waits for a second person");
    await expect(ops.at("step")).toContainText("A second person must approve it");
    await expect(ops.at("hand-arm")).toBeDisabled();
    await expect(ops.at("hand-arm")).toHaveAttribute("title", /second person/);
    // Not one's own.
    await expect(ops.at("to-approve")).toHaveCount(0);

    const card = bob.at("to-approve");
    await expect(card).toContainText("ada asks for your approval");
    await card.getByText("What it does exactly").click();
    await expect(card).toContainText('"on": true');
    await bob.at("approve").click();
    await expect(card).toHaveCount(0);
    await expect(ops.at("approval")).toContainText("approved by bob, holds 9:");
    await ops.at("hand-arm").click();
    await ops.at("send-hand").click();
    await ops.at("tab-log").click();
    await expect(ops.at("command-log").locator("[data-state=done]")).toHaveCount(1);

    // A console that is closed renews nothing: its authority lapses by itself.
    await expect(bob.at("authority-word")).toHaveText("ada commands");
    await ops.page.close();
    await expect(bob.at("authority-word")).toHaveText("Nobody commands", { timeout: 30_000 });
    await bob.page.context().close();
  });
});

test("a sequence is put together, tried dry, ends at its first failure, and goes through when mended", async ({
  ops,
  server,
  watch,
}) => {
  test.setTimeout(200_000);
  await ops.open();
  await server.setDelay(0.1);
  await byHand(ops, "sequence");
  await expect(ops.at("sequence")).toContainText("Empty.");
  await byHand(ops, "wheels");
  await ops.at("hand-release-add").click();
  await ops.at("operating-driving").check();
  await ops.at("hand-mode-add").click();
  await ops.at("hand-brake-add").click();
  await byHand(ops, "sequence");
  await expect(ops.at("step-0")).toContainText("Release all wheels");

  // In this order the rover would refuse the first step: a dry run says so, check by check.
  await ops.at("sequence-dry-run").click();
  await expect(ops.at("dry-run")).toHaveAttribute("data-ready", "false");
  await expect(ops.at("check-content")).toHaveAttribute("data-outcome", "failed");
  await expect(ops.at("check-log")).toHaveAttribute("data-outcome", "passed");
  await expect(ops.at("step-0")).toHaveAttribute("data-outcome", "failed");
  await expect(ops.at("step-1")).toHaveAttribute("data-outcome", "not_reached");
  watch.provoke(/answer: 422 .*\/commands$/, /Failed to load resource/);
  await ops.at("sequence-stage").click();
  await expect(ops.at("sequence-failure")).toContainText("mode driving");
  watch.provoke();
  expect((await server.get<{ commands: unknown[] }>("commands")).commands).toEqual([]);

  // By keyboard: the step goes later. The last waits for what will not be.
  await ops.page.getByRole("button", { name: "Later: Release all wheels" }).press("Enter");
  await expect(ops.at("step-0")).toContainText("Mode driving");
  await expect(ops.at("dry-run"), "another draft").toHaveCount(0);
  await ops.at("step-2-filter").click();
  await ops.at("step-2-field").fill("operation.mode");
  await expect(ops.at("step-2-present")).toHaveText("now ready");
  await ops.at("step-2-value").fill("ready");
  await ops.at("step-2-add").click();
  await expect(ops.at("step-2-conditions")).toContainText("operation.mode is ready");
  await ops.at("sequence-dry-run").click();
  await expect(ops.at("dry-run")).toHaveAttribute("data-ready", "true");
  await expect(ops.at("dry-run-conditions")).toContainText("operation.mode is ready, now ready");

  await ops.at("sequence-stage").click();
  await expect(ops.at("sequence")).toContainText("Empty.");
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  const steps = ops.at("sequence-progress").locator("> li");
  await expect(steps.nth(2)).toHaveAttribute("data-state", "failed", { timeout: 40_000 });
  await expect(steps.nth(0)).toHaveAttribute("data-state", "done");
  await expect(steps.nth(1)).toHaveAttribute("data-state", "done");
  await expect(steps.nth(2)).toContainText("a condition does not hold");
  await ops.at("hand-hide").click();
  await expect(ops.at("sequence-progress")).toHaveCount(0);

  // A wheel's brake by itself, and a heading: single wheels by hand, as one sequence that is done.
  await byHand(ops, "wheels");
  await ops.at("wheels-all").uncheck();
  await ops.at("wheel-leg2").check();
  await ops.at("steer-heading").fill("20");
  await ops.at("hand-steer-add").click();
  await ops.at("hand-brake-add").click();
  await byHand(ops, "sequence");
  await ops.at("sequence-stage").click();
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  await expect(steps.nth(1)).toHaveAttribute("data-state", "done", { timeout: 40_000 });
  await byHand(ops, "wheels");
  await expect(ops.at("brake-leg2")).toHaveText("on");
  await expect(ops.at("brakes-now")).toHaveText("1 of 6 brakes on");
});

test("the commands of a plan go as one sequence", async ({ ops, server }) => {
  await ops.open();
  await server.setDelay(0.1);
  await ops.pickBeside("leg1", 0.25, -0.3);
  const plan = await ops.planWithEnter();
  await ops.at("plan-to-sequence").click();
  const n = plan.commands.length;
  await expect(ops.at(`step-${n - 1}`)).toBeVisible();
  await ops.at("sequence-dry-run").click();
  await expect(ops.at("check-content")).toHaveAttribute("data-outcome", "passed");
  for (let i = 0; i < n; i++) {
    await expect(ops.at(`step-${i}`)).toHaveAttribute("data-outcome", "passed");
  }
  await ops.at("sequence-stage").click();
  await expect(ops.at("sequence-progress").locator("> li")).toHaveCount(n);
});

test("what a command waits for is shown beside the present value, and it is not sent else", async ({
  ops,
  server,
  watch,
}) => {
  await ops.open();
  await server.setDelay(0.1);
  await byHand(ops, "wheels");
  await ops.at("conditions-hand").locator("summary").click();
  await ops.at("hand-channel").selectOption("rover/stability");
  await ops.at("hand-field").fill("regular.margin_m");
  await ops.at("hand-op").selectOption("ge");
  await ops.at("hand-value").fill("50");
  await expect(ops.at("hand-present")).toHaveText(/^now \d+\.\d+$/);
  await ops.at("hand-add").click();
  await expect(ops.at("hand-conditions")).toContainText("regular.margin_m at least 50");
  await stageMode(ops, "driving");
  await ops.at("hand-arm").click();
  watch.provoke(/answer: 409 .*\/send$/, /Failed to load resource/);
  await ops.at("send-hand").click();
  await expect(ops.page.locator(".strip-send [role=alert]")).toContainText("not at least 50");
  await ops.at("take-back").click();
});

test("an outcome that nobody knows is told with what is known, and resolved by a person", async ({
  ops,
  server,
}) => {
  test.setTimeout(120_000);
  await ops.open();
  await server.setDelay(0.1);
  // What goes up is lost without a word.
  await ops.at("link").click();
  await ops.at("outage-seconds").fill("600");
  await ops.at("outage-lose").check();
  await ops.at("outage-begin").click();
  await expect(ops.at("outage-left")).toContainText("Nothing is transmitted");
  await ops.page.keyboard.press("Escape");
  await expect(ops.at("link")).toContainText("Outage");
  await stageMode(ops, "driving");
  await ops.at("hand-arm").click();
  await ops.at("send-hand").click();
  // While no word can come its outcome is not unknown, but only not told yet.
  await expect(ops.at("step")).toContainText(/earliest ack in ([3-9]|\d\d+)/);
  const card = ops.at("unresolved");
  await expect(card).toHaveCount(0);

  // The link comes back, and no word with it: telemetry shows what became of it.
  await ops.at("link").click();
  await ops.at("outage-end").click();
  await ops.page.keyboard.press("Escape");
  await expect(card).toContainText("outcome unknown", { timeout: 30_000 });
  await expect(card).toContainText("It is not sent again by itself");
  await ops.at("resolve-open").click();
  await expect(ops.at("known")).toContainText("the rover has not said that it has it");
  await expect(ops.at("resolve-done")).toBeDisabled();
  await expect(ops.at("evidence")).toHaveAttribute("data-fits", "not_done");
  await expect(ops.at("evidence")).toContainText("reports mode ready; driving was commanded");
  await ops.at("resolve-why").fill("mode is ready, brakes are on");
  await ops.at("resolve-not-done").click();
  await expect(card).toHaveCount(0);
  const { commands } = await server.get<{ commands: { state: string; why: string }[] }>("commands");
  expect(commands.map((c) => c.state)).toEqual(["failed"]);
  expect(commands[0]!.why).toContain("mode is ready, brakes are on");
});

test("a link is chosen from presets, and its counters add up whatever waits", async ({
  ops,
  server,
}) => {
  await ops.open();
  await ops.at("link").click();
  await ops.at("preset-moon_relay").check();
  await expect(ops.at("preset-about")).toContainText("stores and forwards");
  await expect(ops.at("delay-up")).toHaveValue("2");
  await expect(ops.at("rate-up")).toHaveValue("16");
  await ops.at("delay-apply").click();
  await expect(ops.at("delays")).toHaveText("2.0 s2.0 s");
  await ops.at("preset-lab").check();
  await ops.at("delay-apply").click();
  await expect(ops.at("delays")).toHaveText("0.0 s0.0 s");
  const { config } = await server.get<{ config: { up?: object } }>("link");
  expect(config.up, "the lab's link does nothing").toBeUndefined();

  // Values of one's own; what cannot be is marked and not set.
  await ops.at("duplication-down").fill("100");
  await ops.at("loss-down").fill("101");
  await expect(ops.at("delay-apply")).toBeDisabled();
  await ops.at("loss-down").fill("20");
  await expect(ops.at("preset-about")).toHaveText("values of your own");
  await ops.at("delay-apply").click();
  const counters = ops.at("link-counters");
  await expect(counters).toContainText("lost on the way");
  const copies = counters.getByRole("row", { name: "copies made" }).locator("td");
  await expect(copies.nth(0)).toHaveText("0");
  await expect(copies.nth(1)).toHaveText(/^[1-9]\d*$/);
  for (const balance of await ops.at("balance").all()) {
    await expect(balance).toHaveAttribute("data-off", "0");
  }

  // In an outage what is sent waits, and is shown by queue.
  await ops.at("outage-seconds").fill("300");
  await ops.at("outage-begin").click();
  await expect(ops.at("queues-down").locator("[data-class=telemetry]")).toBeVisible();
  for (const balance of await ops.at("balance").all()) {
    await expect(balance).toHaveAttribute("data-off", "0");
  }
  await ops.at("outage-end").click();
  await expect(ops.at("outage-begin")).toBeVisible();
});
