// The ground server that a test starts for itself: the demo mission with the simulated rover.

import { type ChildProcess, spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { PROJECT } from "./files";

export const BINARY = process.env.FOOTFALL_BIN ?? join(PROJECT, "target/debug/footfall");

export class GroundServer {
  private readonly folder = mkdtempSync(join(tmpdir(), "footfall-e2e-"));
  readonly logs = join(this.folder, "logs");
  readonly terrains = join(this.folder, "terrains");
  url = "";
  private child: ChildProcess | null = null;

  /** With these more arguments. */
  constructor(private readonly more: readonly string[] = []) {}

  /** Starts it on a free port, or again on the port that it had. */
  async start(): Promise<void> {
    const port = this.url === "" ? "0" : new URL(this.url).port;
    const child = spawn(
      BINARY,
      ["serve", "--demo", "--port", port, "--logs", this.logs, "--terrains", this.terrains].concat(
        this.more,
      ),
      { stdio: ["ignore", "pipe", "pipe"] },
    );
    this.child = child;
    this.url = await new Promise<string>((resolve, reject) => {
      let said = "";
      const hear = (chunk: Buffer) => {
        said += chunk.toString();
        const address = /http:\/\/127\.0\.0\.1:\d+/.exec(said);
        if (address) resolve(address[0]);
      };
      child.stdout.on("data", hear);
      child.stderr.on("data", hear);
      child.once("error", (error) => reject(new Error(`${BINARY}: ${error.message}`)));
      child.once("exit", (code) => reject(new Error(`${BINARY} ended with ${code}: ${said}`)));
    });
  }

  async stop(): Promise<void> {
    const child = this.child;
    this.child = null;
    if (!child || child.exitCode !== null) return;
    const ended = new Promise((resolve) => child.once("exit", resolve));
    child.kill("SIGKILL");
    await ended;
  }

  /** Ends it and leaves nothing behind. */
  async dispose(): Promise<void> {
    await this.stop();
    rmSync(this.folder, { recursive: true, force: true });
  }

  async get<T>(path: string): Promise<T> {
    return (await fetch(`${this.url}/api/v1/${path}`)).json() as Promise<T>;
  }

  /** The same delay (s) each way. */
  async setDelay(delay_s: number): Promise<void> {
    const answer = await fetch(`${this.url}/api/v1/link`, {
      method: "PUT",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ up_delay_s: delay_s, down_delay_s: delay_s }),
    });
    if (!answer.ok) throw new Error(`PUT /link answered ${answer.status}`);
  }
}
