// The console as its operator uses it, and the fixtures of every test: a server and a watched page.

import { test as base, expect, type Locator, type Page } from "@playwright/test";

import type { FootfallHook } from "../../src/features/scene/debugHook";
import type { PlanAnswer, Vec3 } from "../../src/api/types";
import { GroundServer } from "./server";
import { Watch } from "./watch";

export { expect };

const WHEEL_RADIUS_M = 0.264;

export class Console {
  constructor(
    readonly page: Page,
    readonly server: GroundServer,
  ) {}

  /** Opens the page and waits until rover and ground are drawn and telemetry is fresh. */
  async open(): Promise<void> {
    await this.page.goto(`${this.server.url}/?quality=low`);
    await expect(this.at("leg-leg1")).toBeVisible();
    await this.page.waitForFunction(() => {
      const hook = window.__footfall;
      return hook !== undefined && hook.framesRendered > 2 && !Number.isNaN(hook.height(0, 0));
    });
    await this.page.waitForFunction(() => window.__footfall?.wheel("leg1") != null);
    await expect(this.at("age")).not.toHaveClass(/stale/);
  }

  at(testId: string): Locator {
    return this.page.getByTestId(testId);
  }

  async hook<T>(read: (hook: FootfallHook) => T): Promise<T> {
    return this.page.evaluate(`(${read.toString()})(window.__footfall)`) as Promise<T>;
  }

  wheel(leg: string): Promise<Vec3 | null> {
    return this.page.evaluate((name) => window.__footfall!.wheel(name), leg);
  }

  /** The ground under a leg's wheel, moved by so much (m). */
  async groundBeside(leg: string, dx: number, dy: number): Promise<Vec3> {
    return this.page.evaluate(
      ([name, x, y]) => {
        const wheel = window.__footfall!.wheel(name)!;
        const at = [wheel[0] + x, wheel[1] + y] as const;
        return [at[0], at[1], window.__footfall!.height(at[0], at[1])] as Vec3;
      },
      [leg, dx, dy] as const,
    );
  }

  /** Between a standing wheel's lowest point and the ground as drawn (m). */
  async gapBelow(leg: string): Promise<number> {
    const ground = await this.groundBeside(leg, 0, 0);
    const wheel = (await this.wheel(leg))!;
    return Math.abs(wheel[2] - ground[2] - WHEEL_RADIUS_M);
  }

  /** Clicks the canvas where a point of the world is drawn. */
  async clickGround(point: Vec3): Promise<void> {
    const canvas = this.at("canvas");
    const place = await this.page.evaluate((p) => window.__footfall!.project(...p), point);
    expect(place, "the point is in view").not.toBeNull();
    await canvas.click({ position: place! });
  }

  /** The picked point as the page says it (m). */
  async picked(): Promise<Vec3> {
    const text = (await this.at("pick").textContent()) ?? "";
    const figures = text.replaceAll("−", "-").match(/-?\d+(\.\d+)?/g) ?? [];
    return figures.map(Number) as Vec3;
  }

  /** Chooses a leg and picks the ground beside its wheel. */
  async pickBeside(leg: string, dx: number, dy: number): Promise<Vec3> {
    await this.page.keyboard.press(leg.slice(-1));
    await expect(this.at(`leg-${leg}`)).toHaveAttribute("aria-pressed", "true");
    const place = await this.groundBeside(leg, dx, dy);
    await this.clickGround(place);
    await expect(this.at("pick")).toContainText("Pick");
    return place;
  }

  /** Presses Enter and waits for the plan that comes of it. */
  async planWithEnter(): Promise<PlanAnswer> {
    const answer = this.page.waitForResponse(/\/api\/v1\/plans\/[^/]+$/);
    await this.page.keyboard.press("Enter");
    await expect(this.at("plan-outcome")).toHaveText("Found");
    return (await (await answer).json()) as PlanAnswer;
  }

  /** Stages, arms and sends one command of the plan, and waits until the rover has done it. */
  async execute(index: number): Promise<void> {
    await this.at(`stage-${index}`).click();
    await this.release(`${index}`);
    await this.expectDone(`${index}`);
  }

  /** Arms and sends what is staged, a command of the plan or, as `back-2`, of its way back. */
  async release(name: string): Promise<void> {
    const row = this.at(`command-${name}`);
    await expect(row).toHaveAttribute("data-state", "staged");
    await this.at(`arm-${name}`).click();
    await expect(row).toHaveAttribute("data-state", "armed");
    await this.at(`send-${name}`).click();
    await expect(row).toHaveAttribute("data-state", "executing");
  }

  async expectDone(name: string): Promise<void> {
    const row = this.at(`command-${name}`);
    await expect(row).toHaveAttribute("data-state", "done", { timeout: 60_000 });
  }

  /** Waits until a leg's wheel is drawn within 2 cm of a place. */
  async expectWheelAt(leg: string, place: Vec3): Promise<void> {
    await expect
      .poll(async () => distance((await this.wheel(leg)) ?? [NaN, NaN, NaN], place), {
        message: `${leg} is at ${place.map((v) => v.toFixed(3)).join(", ")}`,
      })
      .toBeLessThan(0.02);
  }
}

export function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

interface Fixtures {
  server: GroundServer;
  watch: Watch;
  /** Not opened yet. */
  ops: Console;
}

export const test = base.extend<Fixtures>({
  // Playwright reads the names of the parameters, so that there must be a pattern.
  // eslint-disable-next-line no-empty-pattern
  server: async ({}, use) => {
    const server = new GroundServer();
    await server.start();
    await use(server);
    await server.dispose();
  },
  watch: async ({ page }, use) => {
    const watch = new Watch(page);
    await use(watch);
    expect(watch.found(), "errors of the page").toEqual([]);
  },
  ops: async ({ page, server, watch }, use) => {
    expect(watch.found()).toEqual([]);
    await use(new Console(page, server));
    // Closed before the server is, so that its end is no error of the page.
    await page.close();
  },
});
