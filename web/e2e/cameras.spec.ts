// From chosen pairs to a map: coverage before asking, progress pair by pair, what came of it, a step on it, and the
// hole that the leg left, closed.

import type {
  CellAnswer,
  CoverageAnswer,
  RoverAnswer,
  TerrainVersions,
  Vec2,
} from "../src/api/types";
import { type Console, expect, test } from "./support/console";
import type { GroundServer } from "./support/server";

const PAIRS = ["nav1", "haz1", "haz2"];

test("three pairs make a map with holes, a step is walked on it, and the holes close", async ({
  ops,
  page,
  server,
}) => {
  test.setTimeout(400_000);
  await server.setDelay(0.05);
  await ops.open();
  const at = (testId: string) => ops.at(testId);
  await page.keyboard.press("m");
  await expect(at("pairs-empty")).toBeVisible();

  await test.step("pairs are chosen with the keyboard, and what they would see is told", async () => {
    await at("pair-nav1").focus();
    await page.keyboard.press("Space");
    // Around the rover: beside NavCam 1 sits HazCam 1.
    await page.keyboard.press("ArrowLeft");
    await expect(at("pair-haz1")).toBeFocused();
    await page.keyboard.press("Space");
    await at("pair-haz2").check();
    for (const name of PAIRS) await expect(at(`pair-${name}`)).toBeChecked();
    await expect(at("coverage")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
    await expect(at("coverage")).toContainText(/Would see \d+ % of the ground/);
    await expect(at("overlay-coverage")).toBeChecked();
    await expect(at("cost")).toContainText("1.2 MB");
    // A quarter of the size is a sixteenth of the work.
    await at("wishes").click();
    await at("detail-quick").check();
    await expect(at("cost")).toContainText("295 kB");
  });

  const before = await coverage(server);
  const hidden = before.hidden.find((part) => part.by === "leg1")!;
  expect(hidden.area_m2, "leg 1 hides ground").toBeGreaterThan(0.05);
  await expect(at("hidden-leg1")).toContainText(`${hidden.area_m2.toFixed(1)} m²`);

  await test.step("a request can be taken back and changes nothing", async () => {
    await at("ask-pairs").click();
    await expect(at("progress-nav1")).toBeVisible();
    await at("pairs-cancel").click();
    await expect(at("ask-pairs")).toBeVisible();
    expect((await versions(server)).versions).toHaveLength(1);
  });

  await askAndWait(ops, async () => {
    await expect(at("progress-haz2")).toHaveAttribute("data-stage", "requested");
    await expect(at("progress-nav1")).toHaveAttribute("data-stage", "matched", { timeout: 60_000 });
  });
  await expect(at("changes")).toContainText("Added NavCam 1, HazCam 1, HazCam 2");
  const [first] = (await versions(server)).versions;
  expect(first!.pairs!.map((pair) => pair.name)).toEqual(PAIRS);
  expect(first!.changes!.new_m2).toBeGreaterThan(5);
  for (const pair of first!.pairs!) await expect(at(`capture-${pair.source}`)).toBeVisible();
  const hole = hidden.place_m as Vec2;
  expect(await seenBy(server, hole), "the ground that leg 1 hides is a hole").toBeNull();

  await test.step("the layers of the map, and the pictures it comes from", async () => {
    for (const layer of ["sigma", "age", "source", "difference"]) {
      await at("map-layer").selectOption(layer);
      await expect(at("map-layer-state")).toHaveAttribute("data-state", "ready");
    }
    await at("pictures-" + first!.pairs![1]!.source).click();
    for (const kind of ["raw", "rectified", "disparity"]) {
      await at(`pictures-${kind}`).check();
      const shown = at("pictures").locator(".picture");
      await expect(shown).toHaveCount(2);
      for (const i of [0, 1]) await expect(shown.nth(i)).toHaveAttribute("data-state", "ready");
    }
    await page.keyboard.press("Escape");
    await expect(at("pictures")).toBeHidden();
  });

  await test.step("lift, look again, place: the hole closes while the leg is up", async () => {
    await at("hidden-leg1").click();
    await expect(at("leg-leg1")).toHaveAttribute("aria-pressed", "true");
    await expect(at("reimage")).toHaveAttribute("data-stage", "lift");
    await ops.pickBeside("leg1", 0.25, -0.3);
    await at("reimage-lift").click();
    await expect(at("plan-outcome")).toHaveText("Found");
    await ops.execute(0);
    await at("tab-map").click();
    await expect(at("reimage")).toHaveAttribute("data-stage", "ask");
    await at("reimage-ask").click();
    await expect(at("reimage")).toHaveAttribute("data-stage", "place", { timeout: 120_000 });
    await at("reimage-place").click();
    await expect(at("plan-outcome")).toHaveText("Found", { timeout: 30_000 });
    const rest = await page.getByTestId(/^stage-\d+$/).count();
    expect(rest, "transit, drop, preload").toBe(3);
    for (let i = 0; i < rest; i++) await ops.execute(i);
    await at("tab-map").click();
    await expect(at("reimage")).toHaveAttribute("data-stage", "done");
  });

  await test.step("where the wheel came down the map has its height", async () => {
    await expect
      .poll(async () => (await versions(server)).versions.map((version) => version.changes?.what))
      .toContain("wheel contact: leg1");
    const { current } = await versions(server);
    const rover = await server.get<RoverAnswer>("rover");
    const [x, y, z] = rover.latest!.frame.contact_points_m["leg1"]!;
    const cell = await server.get<CellAnswer>(`terrain/${current}/cell?x_m=${x}&y_m=${y}`);
    expect(cell.height_m).toBeCloseTo(z!, 2);
  });

  await test.step("the same pairs, asked again, see what leg 1 hid before", async () => {
    await at("pairs-none").click();
    for (const name of PAIRS) await at(`pair-${name}`).check();
    await askAndWait(ops);
    const seen = await seenBy(server, hole);
    expect(PAIRS, "the hole is closed").toContain(seen);
  });

  await test.step("a capture is taken out, and the version before is put in use again", async () => {
    const { current, versions: all } = await versions(server);
    const last = all.find((v) => v.version === current)!.pairs!.at(-1)!;
    await at(`remove-${last.source}`).click();
    await expect(at(`capture-${last.source}`)).toBeHidden();
    await expect(at("changes")).toContainText("Without");
    await at(`version-${current}`).click();
    await expect(at(`capture-${last.source}`)).toBeVisible();
    expect((await versions(server)).current).toBe(current);
  });
});

const versions = (server: GroundServer) => server.get<TerrainVersions>("terrain/versions");

async function coverage(server: GroundServer): Promise<CoverageAnswer> {
  const answer = await fetch(`${server.url}/api/v1/rover/cameras/coverage`, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ cameras: PAIRS }),
  });
  return (await answer.json()) as CoverageAnswer;
}

/** The pair that saw a place of the map in use; null where none did. */
async function seenBy(server: GroundServer, [x, y]: Vec2): Promise<string | null> {
  const { current } = await versions(server);
  const cell = await server.get<{ seen?: { camera: string | null; prior: boolean } }>(
    `terrain/${current}/cell?x_m=${x}&y_m=${y}`,
  );
  return cell.seen && !cell.seen.prior ? cell.seen.camera : null;
}

/** Asks the chosen pairs and waits for the version that comes of it. */
async function askAndWait(ops: Console, meanwhile: () => Promise<void> = async () => {}) {
  const answered = ops.page.waitForResponse(/\/terrain\/reconstructions\/[^/]+$/, {
    timeout: 150_000,
  });
  await ops.at("ask-pairs").click();
  await meanwhile();
  expect((await answered).ok()).toBe(true);
  await expect(ops.at("ask-pairs")).toBeVisible();
  await expect(ops.at("map-layer-state")).toHaveAttribute("data-state", "ready", {
    timeout: 60_000,
  });
}
