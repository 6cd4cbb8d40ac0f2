// The long forms of the tests, one part after the other, with the time that each took; what `make soak` runs.
// All are built first, with one choice of packages, so that nothing is built twice and no build is timed.
// A part that takes longer than it may is ended and counts as failed. Arguments: names of parts, else all.
import { execFileSync, spawnSync } from "node:child_process";
import { join } from "node:path";

const PACKAGES = ["bridge", "collision", "motion", "server", "terrain"];
/** The clock is looked at in these: one at a time, and nothing beside them. */
const ALONE = ["--test-threads", "1"];
const FULL = { FOOTFALL_FULL: "1" };
const REQUESTS = { FOOTFALL_SOAK: process.env.FOOTFALL_SOAK ?? "100000" };

/** Name, package, most seconds, environment, arguments. The seconds add up to half an hour. */
const PARTS = [
  ["generated step requests", "motion", 300, REQUESTS, ["soak"]],
  ["generated requests over HTTP", "server", 120, REQUESTS, ["soak"]],
  ["collision", "collision", 240, FULL, []],
  ["final check, body shift", "motion", 150, FULL, ["final_check", "body_shift"]],
  ["damaged terrain files", "terrain", 60, FULL, ["damaged"]],
  [
    "link and commands",
    "bridge",
    300,
    FULL,
    ["link::", "histories::", "authority::", "carrier::", "partition::", "preconditions::"],
  ],
  [
    "flight log",
    "bridge",
    330,
    FULL,
    ["--skip", "a_power_cut_costs", "bounds::", "catalog::", "chain::", "conformance::", "crash::"].concat([
      "damage::",
      "disk_full::",
      "kill::",
      "replay::",
      "stock_reader::",
    ]),
  ],
  ["power cuts, a log of a day", "bridge", 150, FULL, [...ALONE, "a_power_cut_costs", "large_log::"]],
  ["many consoles, two processes", "server", 150, FULL, [...ALONE, "consoles::", "rover_process::"]],
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
const programs = built();
const table = [];
for (const [name, crate, most_s, environment, args] of PARTS) {
  if (wanted.length > 0 && !wanted.includes(name)) continue;
  console.log(`\n== ${name}`);
  const { executable, folder } = programs[crate];
  const begun = Date.now();
  const { status, signal } = spawnSync(executable, ["--nocapture", ...args], {
    cwd: folder,
    env: { ...process.env, ...environment, CARGO_MANIFEST_DIR: folder },
    stdio: ["ignore", "inherit", "inherit"],
    timeout: most_s * 1000,
    killSignal: "SIGKILL",
  });
  const outcome = status === 0 ? "passed" : signal ? "TOO LONG" : "FAILED";
  table.push([name, `${((Date.now() - begun) / 1000).toFixed(0)} s`, `${most_s} s`, outcome]);
}
const rows = [["part", "took", "at most", ""], ...table];
const width = rows[0].map((_, i) => Math.max(...rows.map((row) => row[i].length)));
console.log();
for (const row of rows) console.log(row.map((cell, i) => cell.padEnd(width[i])).join("  "));
process.exit(table.every((row) => row[3] === "passed") ? 0 : 1);
