// The program under test as a process.

import { type ChildProcess, spawn } from "node:child_process";
import { join } from "node:path";

import { PROJECT } from "./files";

export const BINARY = process.env.FOOTFALL_BIN ?? join(PROJECT, "target/debug/footfall");

/** Starts it, where given by another program, which takes it and its arguments. */
export function begin(args: readonly string[], by: readonly string[] = []): ChildProcess {
  const [program, ...rest] = [...by, BINARY, ...args];
  return spawn(program!, rest, { stdio: ["ignore", "pipe", "pipe"] });
}

/** Where it says that it listens: the first match of `address`. */
export function said(child: ChildProcess, address: RegExp): Promise<string> {
  return new Promise<string>((resolve, reject) => {
    let text = "";
    const hear = (chunk: Buffer) => {
      text += chunk.toString();
      const found = address.exec(text);
      if (found) resolve(found[0]);
    };
    child.stdout?.on("data", hear);
    child.stderr?.on("data", hear);
    child.once("error", (error) => reject(new Error(`${BINARY}: ${error.message}`)));
    child.once("exit", (code) => reject(new Error(`${BINARY} ended with ${code}: ${text}`)));
  });
}

/** Kills it, and waits for its end. */
export async function kill(child: ChildProcess | null): Promise<void> {
  if (!child || child.exitCode !== null) return;
  const ended = new Promise((resolve) => child.once("exit", resolve));
  child.kill("SIGKILL");
  await ended;
}
