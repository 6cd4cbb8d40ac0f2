// One table of all benchmarks that Criterion has measured: median, budget where there is one, and
// how it compares with the baseline of its group: the benchmark named "(baseline)", or the simple
// way to do the same work.
import { readFileSync, readdirSync, existsSync } from "node:fs";
import { join } from "node:path";

const root = process.argv[2] ?? "target/criterion";
/** Budgets on two cores: longest time (ns), or lowest rate (elements a second). */
const BUDGETS = {
  "fan-out, 200 consoles, 50 messages of 1 kB a second/from bus to console, p99": { ns: 100e6 },
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

/** The budget, and whether it is met. */
function budget(row) {
  const allowed = BUDGETS[row.id];
  if (allowed === undefined) return "";
  const met = allowed.ns !== undefined ? row.ns <= allowed.ns : perSecond(row) >= allowed.rate;
  const text = allowed.ns !== undefined ? `≤ ${time(allowed.ns)}` : `≥ ${rate(allowed.rate)}`;
  return `${text} ${met ? "met" : "not met"}`;
}

const lines = rows.map((row) => {
  const baseline = rows.find((other) => other.group === row.group && isBaseline(other.name));
  const cost = (r) => r.ns / (r.elements !== null && baseline?.elements !== null ? r.elements : 1);
  const ratio =
    baseline === undefined ? "-" : baseline === row ? "1" : (cost(row) / cost(baseline)).toPrecision(3);
  return [row.id, time(row.ns), row.elements === null ? "" : rate(perSecond(row)), budget(row), ratio];
});
if (lines.length === 0) {
  console.error("No benchmark has been measured yet.");
  process.exit(3);
}
const table = [["benchmark", "median", "rate", "budget", "× baseline"], ...lines];
const width = table[0].map((_, i) => Math.max(...table.map((line) => [...line[i]].length)));
for (const line of table) {
  console.log(
    line.map((cell, i) => (i === 0 ? cell.padEnd(width[i]) : cell.padStart(width[i]))).join("  "),
  );
}
