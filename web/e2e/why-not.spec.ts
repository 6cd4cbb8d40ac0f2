// Why is a cell not offered? For a cell of every kind of reason, live and in a replay, by two gestures: a leg is
// chosen while the overlay is on, and the place is pointed at.

import { type ReachGrid, readReachGrid } from "../src/api/tiles";
import type { LogList } from "../src/api/types";
import { type Console, expect, test } from "./support/console";

interface Kind {
  name: string;
  /** Numbers of reasons of the reachability grid (`reachability::Reason`). */
  reasons: number[];
  verdict: string;
  says: RegExp;
  /** With the amount that is missing, and what was tried. */
  missing: boolean;
}

const KINDS: Kind[] = [
  {
    name: "unknown",
    reasons: [3],
    verdict: "unknown",
    says: /Nobody has seen the ground/,
    missing: false,
  },
  {
    name: "out of reach",
    reasons: [1, 2],
    verdict: "unreachable",
    says: /Out of reach|A joint beyond its limit/,
    missing: true,
  },
  {
    name: "colliding",
    reasons: [6, 7],
    verdict: "colliding",
    says: /The leg too near to the (ground|rover)/,
    missing: true,
  },
  { name: "no lift", reasons: [8, 9], verdict: "no lift", says: /lift waypoint/, missing: true },
  {
    name: "too steep or rough",
    reasons: [11, 13],
    verdict: "unreachable",
    says: /too uneven|unsafe for a wheel/,
    missing: true,
  },
  {
    name: "unstable",
    reasons: [4, 5],
    verdict: "unstable",
    says: /too little stability margin|a settling foot/i,
    missing: true,
  },
];

const SIZE = 151;
const STEP = 0.1;

/** Height (m) of a plane with a rock, a slope and rough ground about the feet; NaN where nobody has looked. */
function height(x: number, y: number): number {
  const azimuth = Math.atan2(y, x);
  const radius = Math.hypot(x, y);
  const near = (at: number) => Math.abs(Math.atan2(Math.sin(azimuth - at), Math.cos(azimuth - at)));
  const sixth = Math.PI / 3;
  if (near(0) < 0.12 && radius > 2.7 && radius < 3.3) return NaN;
  if (near(sixth) < 0.25 && radius > 2.5 && radius < 2.9) return 0.9;
  if (near(2 * sixth) < 0.3 && radius > 2.5) return 0.9 * (radius - 2.5);
  const rough = near(Math.PI) < 0.3 && radius > 2.5;
  return rough ? 0.12 * ((Math.round(x / STEP) + Math.round(y / STEP)) % 2) : 0;
}

/** The ground as a mesh, without the triangles that nobody has seen. */
function mesh(): string {
  const at = (i: number) => (i - (SIZE - 1) / 2) * STEP;
  const vertices: string[] = [];
  const known: boolean[] = [];
  for (let row = 0; row < SIZE; row++) {
    for (let col = 0; col < SIZE; col++) {
      const z = height(at(col), at(row));
      known.push(!Number.isNaN(z));
      vertices.push(
        `${at(col).toFixed(2)} ${at(row).toFixed(2)} ${(known.at(-1) ? z : 0).toFixed(3)}`,
      );
    }
  }
  const faces: string[] = [];
  for (let row = 0; row + 1 < SIZE; row++) {
    for (let col = 0; col + 1 < SIZE; col++) {
      const [a, b] = [row * SIZE + col, (row + 1) * SIZE + col];
      for (const face of [
        [a, a + 1, b + 1],
        [a, b + 1, b],
      ]) {
        if (face.every((i) => known[i])) faces.push(`3 ${face.join(" ")}`);
      }
    }
  }
  return ["OFF", `${vertices.length} ${faces.length} 0`, ...vertices, ...faces, ""].join("\n");
}

/** Cells with one of these reasons, those first that are surrounded by their like. */
function cellsOf({ header, reasons, classes }: ReachGrid, wanted: number[]): [number, number][] {
  const [nx, ny] = header.size;
  const alike = (col: number, row: number) => {
    const i = row * nx + col;
    return (
      col >= 0 &&
      row >= 0 &&
      col < nx &&
      row < ny &&
      wanted.includes(reasons[i]!) &&
      classes[i] !== 4
    );
  };
  const found: { at: [number, number]; company: number }[] = [];
  for (let row = 0; row < ny; row++) {
    for (let col = 0; col < nx; col++) {
      if (!alike(col, row)) continue;
      let company = 0;
      for (let dx = -2; dx <= 2; dx++)
        for (let dy = -2; dy <= 2; dy++) company += Number(alike(col + dx, row + dy));
      const at = (i: number, origin: number) => origin + i * header.resolution_m;
      found.push({ at: [at(col, header.origin_m[0]), at(row, header.origin_m[1])], company });
    }
  }
  found.sort((a, b) => b.company - a.company);
  return found.map(({ at }) => at);
}

interface Found {
  kind: Kind;
  leg: string;
  at: [number, number];
}

/** Points at a place; true if the page reads it as that cell, and not as what hides it. */
async function pointAt(ops: Console, [x, y]: [number, number]): Promise<boolean> {
  const place = await ops.page.evaluate(
    ([px, py]) => {
      const z = window.__footfall!.height(px, py);
      return window.__footfall!.project(px, py, Number.isNaN(z) ? 0 : z);
    },
    [x, y] as const,
  );
  const box = (await ops.at("canvas").boundingBox())!;
  if (!place || place.x < 0 || place.y < 0 || place.x > box.width || place.y > box.height)
    return false;
  await ops.page.mouse.move(box.x + place.x, box.y + place.y);
  await ops.page.mouse.move(box.x + place.x + 0.5, box.y + place.y);
  const text = async () =>
    (await ops.page
      .getByLabel("Place", { exact: true })
      .locator(".row .num")
      .first()
      .textContent({ timeout: 1000 })
      .catch(() => "")) ?? "";
  // The read-out follows the pointer at the pace of the picture.
  for (let i = 0; i < 6; i++) {
    const [rx, ry] = ((await text()).replaceAll("−", "-").match(/-?\d+\.\d+/g) ?? []).map(Number);
    if (rx !== undefined && Math.hypot(rx - x, ry! - y) < 0.04) return true;
    await ops.page.waitForTimeout(100);
  }
  return false;
}

/** The read-out of a cell: its verdict, its reason, what is missing, and what was tried. */
async function expectTold(ops: Console, { kind, leg, at }: Found): Promise<void> {
  expect(await pointAt(ops, at), `${kind.name} of ${leg} at ${at.join(", ")} is in view`).toBe(
    true,
  );
  const told = ops.at("why-not");
  await expect(told).toContainText(`Leg ${leg.slice(-1)}: ${kind.verdict}`);
  await expect(told).toContainText(kind.says);
  if (kind.missing) await expect(told).toContainText(/missing\s*[\d.]+/);
  await expect(ops.at("what-helps")).not.toContainText("Looking for", { timeout: 30_000 });
  await expect(ops.at("what-helps")).not.toBeEmpty();
}

async function choose(ops: Console, leg: string): Promise<void> {
  await ops.page.keyboard.press(leg.slice(-1));
  await expect(ops.at(`leg-${leg}`)).toHaveAttribute("aria-pressed", "true");
  await expect(ops.at("reach-state")).toHaveAttribute("data-state", "ready", { timeout: 60_000 });
}

test("a cell of every kind says why it is not offered, live and in a replay", async ({
  ops,
  page,
  server,
}) => {
  test.setTimeout(240_000);
  await ops.open();
  await server.setDelay(0.1);
  await ops.at("import-open").click();
  await ops.at("import-file").check();
  const file = { name: "all-kinds.off", mimeType: "text/plain", buffer: Buffer.from(mesh()) };
  await ops.at("import-upload").setInputFiles(file);
  await ops.at("import-start").click();
  await expect(ops.at("import")).toHaveCount(0, { timeout: 60_000 });
  await expect.poll(() => ops.gapBelow("leg6")).toBeLessThan(0.1);
  await ops.at("plan-options").click();
  await ops.at("preference-conservative").check();
  await ops.at("overlay-reachability").check();

  const found: Found[] = [];
  for (const leg of ["leg1", "leg2", "leg3", "leg4", "leg5", "leg6"]) {
    const answer = page.waitForResponse(/\/analysis\/reachability$/);
    await page.keyboard.press(leg.slice(-1));
    const grid = readReachGrid((await (await answer).body()).buffer as ArrayBuffer);
    await choose(ops, leg);
    for (const kind of KINDS.filter((k) => found.every((f) => f.kind !== k))) {
      for (const at of cellsOf(grid, kind.reasons).slice(0, 8)) {
        if (!(await pointAt(ops, at))) continue;
        const one = { kind, leg, at };
        await test.step(`${kind.name}, ${leg}`, () => expectTold(ops, one));
        found.push(one);
        break;
      }
    }
  }
  expect(found.map((f) => f.kind.name).sort()).toEqual(KINDS.map((k) => k.name).sort());

  await test.step("a replay tells the same", async () => {
    const { logs } = await server.get<LogList>("logs");
    await ops.at("mode-menu").click();
    await ops.at(`replay-${logs[0]!.id}`).click();
    await expect(ops.at("mode")).toHaveText("REPLAY");
    await expect(ops.at("opening")).toHaveCount(0);
    await ops.at("replay-toggle").click();
    await ops.at("replay-scrub").focus();
    await page.keyboard.press("End");
    await ops.at("replay-scrub").blur();
    for (const one of found) {
      await choose(ops, one.leg);
      await expectTold(ops, one);
    }
  });
});
