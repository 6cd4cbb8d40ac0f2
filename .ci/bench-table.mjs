// Two tables of what Criterion has measured. All benchmarks: median, and how it compares with the baseline
// of its group, which is the benchmark named "(baseline)" or the simple way to do the same work. Then all
// budgets, those too of which nothing was measured: measured over allowed, so that 1 and less is met.
import { readFileSync, readdirSync, existsSync } from "node:fs";
import { join } from "node:path";

const root = process.argv[2] ?? "target/criterion";
/** Budgets on two cores: longest time (ns), or lowest rate (elements a second). */
const BUDGETS = {
  "fan-out, 200 consoles, 50 messages of 1 kB a second/from bus to console, p99": { ns: 100e6 },
  "link of 1.3 s, 100 messages a second/delay error, p99": { ns: 2e6 },
  "replay at speed 1, 200 messages a second/timing error, p99": { ns: 5e6 },
  "replay, seek in a large log, nothing of it in the page cache/p99": { ns: 200e6 },
  "ten times the work that can be done/refused, p99": { ns: 50e6 },
  "ten times the work that can be done/E-stop until it is with the link, worst of 50": { ns: 5e6 },
  "first path of a step/mixed scenes, automatic": { rate: 1e3 },
  "leg_check/one configuration with tolerances": { ns: 2e3 },
  "leg_ik/all branches of one wheel pose": { ns: 1e3 },
  "matching 1024 x 768 of 128 disparities/one thread": { ns: 130e6 },
  "polygons of six contacts/regular, conservative, friction, and energy margin": { ns: 30e3 },
  "reach/one leg, 2 cm cells, two threads": { ns: 50e6 },
  "reach/one leg, level ground, 2 cm cells, two threads": { ns: 50e6 },
  "reach/six legs, 2 cm cells, two threads": { ns: 250e6 },
  "reach/six legs, level ground, 2 cm cells, two threads": { ns: 250e6 },
  "recorder, 200 B messages/record, commit, close": { rate: 200e3 },
  "step/around a rock, automatic": { ns: 5e6 },
  "torques of a stance on five legs/least largest torque": { ns: 50e3 },
  "traversability/1024 x 1024/2 % holes": { rate: 20e6 },
  "whole step/mixed scenes, automatic": { rate: 200 },
};
const isBaseline = (name) => /\(baseline\)|^plain |^brute force/.test(name);

function measured(folder) {
  if (!existsSync(folder)) return [];
  const here = join(folder, "new", "estimates.json");
  const found = existsSync(here) ? [folder] : [];
  for (const entry of readdirSync(folder, { withFileTypes: true })) {
    if (entry.isDirectory() && entry.name !== "new" && entry.name !== "base") {
      found.push(...measured(join(folder, entry.name)));
    }
  }
  return found;
}

const rows = measured(root).map((folder) => {
  const json = (name) => JSON.parse(readFileSync(join(folder, "new", name), "utf8"));
  const about = json("benchmark.json");
  const elements = about.throughput?.Elements ?? null;
  // A benchmark without a group has its group in front of a slash.
  const [group, ...rest] = about.full_id.split("/");
  return {
    group,
    name: rest.join("/") || group,
    id: about.full_id,
    ns: json("estimates.json").median.point_estimate,
    elements,
  };
});
rows.sort((a, b) => (a.id < b.id ? -1 : 1));

function time(ns) {
  for (const [unit, size] of [["s", 1e9], ["ms", 1e6], ["µs", 1e3]]) {
    if (ns >= size) return `${(ns / size).toPrecision(3)} ${unit}`;
  }
  return `${ns.toPrecision(3)} ns`;
}

const perSecond = (row) => (row.elements / row.ns) * 1e9;

function rate(n) {
  for (const [unit, size] of [["M/s", 1e6], ["k/s", 1e3]]) {
    if (n >= size) return `${(n / size).toPrecision(3)} ${unit}`;
  }
  return `${n.toPrecision(3)} /s`;
}

/** A budget with what was measured; the ratio is above 1 where it is not met. */
function against([id, allowed]) {
  const row = rows.find((row) => row.id === id);
  const text = allowed.ns !== undefined ? `≤ ${time(allowed.ns)}` : `≥ ${rate(allowed.rate)}`;
  if (row === undefined) return [id, text, "not measured", "", ""];
  const byTime = allowed.ns !== undefined;
  const ratio = byTime ? row.ns / allowed.ns : allowed.rate / perSecond(row);
  const measured = byTime ? time(row.ns) : rate(perSecond(row));
  return [id, text, measured, ratio.toPrecision(3), ratio <= 1 ? "met" : "NOT MET"];
}

function print(table) {
  const width = table[0].map((_, i) => Math.max(...table.map((line) => [...line[i]].length)));
  for (const line of table) {
    console.log(
      line.map((cell, i) => (i === 0 ? cell.padEnd(width[i]) : cell.padStart(width[i]))).join("  "),
    );
  }
}

const lines = rows.map((row) => {
  const baseline = rows.find((other) => other.group === row.group && isBaseline(other.name));
  const cost = (r) => r.ns / (r.elements !== null && baseline?.elements !== null ? r.elements : 1);
  const ratio =
    baseline === undefined ? "-" : baseline === row ? "1" : (cost(row) / cost(baseline)).toPrecision(3);
  return [row.id, time(row.ns), row.elements === null ? "" : rate(perSecond(row)), ratio];
});
if (lines.length === 0) {
  console.error("No benchmark has been measured yet.");
  process.exit(3);
}
print([["benchmark", "median", "rate", "× baseline"], ...lines]);
console.log();
print([["budget", "allowed", "measured", "measured / allowed", ""], ...Object.entries(BUDGETS).map(against)]);
