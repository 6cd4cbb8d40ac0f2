// The long forms of the tests, one part after the other, with the time that each took; what `make soak` runs.
// All are built first, with one choice of packages, so that nothing is built twice and no build is timed. What
// does not fit in half an hour is ended and counts as failed. Arguments: names of parts, else all.
import { execFileSync, spawnSync } from "node:child_process";
import { join } from "node:path";

const PACKAGES = ["bridge", "collision", "motion", "server", "terrain"];
/** The clock is looked at in these: one at a time, and nothing beside them. */
const ALONE = ["--test-threads", "1"];
const FULL = { FOOTFALL_FULL: "1" };
const REQUESTS = { FOOTFALL_SOAK: process.env.FOOTFALL_SOAK ?? "100000" };

/** Longest time of all parts together (s). */
const MOST_S = 1800;

/** Name, package, environment, arguments. */
const PARTS = [
  [
    "link and commands",
    "bridge",
    FULL,
    ["link::", "histories::", "authority::", "carrier::", "partition::", "preconditions::"],
  ],
  [
    "flight log",
    "bridge",
    FULL,
    "--skip a_power_cut_costs bounds:: catalog:: chain:: conformance:: crash:: damage:: disk_full:: kill:: replay:: stock_reader::".split(
      " ",
    ),
  ],
  ["power cuts, a log of a day", "bridge", FULL, [...ALONE, "a_power_cut_costs", "large_log::"]],
  ["many consoles, two processes", "server", FULL, [...ALONE, "consoles::", "rover_process::"]],
  ["damaged terrain files", "terrain", FULL, ["damaged"]],
  ["final check, body shift", "motion", FULL, ["final_check", "body_shift"]],
  ["collision", "collision", FULL, []],
  ["generated requests over HTTP", "server", REQUESTS, ["soak"]],
  ["generated step requests", "motion", REQUESTS, ["soak"]],
];

function built() {
  const packages = PACKAGES.flatMap((name) => ["-p", name]);
  const args = ["test", "--release", "--locked", ...packages, "--test", "it", "--no-run"];
  const output = execFileSync("cargo", [...args, "--message-format", "json-render-diagnostics"], {
    encoding: "utf8",
    maxBuffer: 1 << 28,
    stdio: ["ignore", "pipe", "inherit"],
  });
  const programs = {};
  for (const line of output.split("\n")) {
    if (!line.startsWith("{")) continue;
    const { reason, executable, target, manifest_path } = JSON.parse(line);
    if (reason === "compiler-artifact" && executable && target.name === "it") {
      const folder = join(manifest_path, "..");
      programs[folder.split("/").pop()] = { executable, folder };
    }
  }
  return programs;
}

const wanted = process.argv.slice(2);
const unknown = wanted.find((name) => PARTS.every(([part]) => part !== name));
if (unknown !== undefined) {
  console.error(`There is no part ${unknown}; there are: ${PARTS.map(([name]) => name).join("; ")}.`);
  process.exit(2);
}
const programs = built();
const begun = Date.now();
const past_s = (since) => (Date.now() - since) / 1000;
const table = [];
for (const [name, crate, environment, args] of PARTS) {
  if (wanted.length > 0 && !wanted.includes(name)) continue;
  console.log(`\n== ${name}`);
  const { executable, folder } = programs[crate];
  const since = Date.now();
  const { status, signal } = spawnSync(executable, ["--nocapture", ...args], {
    cwd: folder,
    env: { ...process.env, ...environment },
    stdio: ["ignore", "inherit", "inherit"],
    timeout: Math.max(1, MOST_S - past_s(begun)) * 1000,
    killSignal: "SIGKILL",
  });
  const outcome = status === 0 ? "passed" : signal ? "NO TIME LEFT" : "FAILED";
  table.push([name, `${past_s(since).toFixed(0)} s`, outcome]);
}
table.push(["all", `${past_s(begun).toFixed(0)} s`, `of ${MOST_S} s`]);
const rows = [["part", "took", ""], ...table];
const width = rows[0].map((_, i) => Math.max(...rows.map((row) => row[i].length)));
console.log();
for (const row of rows) console.log(row.map((cell, i) => cell.padEnd(width[i])).join("  ").trimEnd());
process.exit(table.slice(0, -1).every(([, , outcome]) => outcome === "passed") ? 0 : 1);
