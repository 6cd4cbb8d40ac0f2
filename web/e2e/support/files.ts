// Where the project is, and the shared test data beside it.

import { appendFileSync, existsSync, mkdirSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

export const PROJECT = join(dirname(fileURLToPath(import.meta.url)), "../../..");

/**
 * The path of a file of the shared test data, or null with a note that `test` was skipped: on
 * standard error and in target/skipped-tests.txt, as the tests of the crates do it.
 */
export function sharedData(test: string, path: string): string | null {
  const root = process.env.FOOTFALL_SHARED_DATA ?? join(PROJECT, "../shared/data");
  const full = join(root, path);
  if (existsSync(full)) return full;
  // Test files are read once to list their tests and again by each worker: said once.
  if (process.env.TEST_WORKER_INDEX !== undefined) return null;
  const note = `SKIPPED ${test}: shared data ${path} is absent`;
  console.error(note);
  mkdirSync(join(PROJECT, "target"), { recursive: true });
  appendFileSync(join(PROJECT, "target/skipped-tests.txt"), note + "\n");
  return null;
}
