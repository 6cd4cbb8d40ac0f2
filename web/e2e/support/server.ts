// The ground server that a test starts for itself: the demo mission with the simulated rover.

import type { ChildProcess } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { begin, kill, said } from "./program";

export class GroundServer {
  private readonly folder = mkdtempSync(join(tmpdir(), "footfall-e2e-"));
  readonly logs = join(this.folder, "logs");
  readonly terrains = join(this.folder, "terrains");
  url = "";
  private child: ChildProcess | null = null;

  /** With these more arguments; `by` gives the program that starts it, from the folder of its logs. */
  constructor(
    private readonly more: readonly string[] = [],
    private readonly by: (logs: string) => readonly string[] = () => [],
  ) {}

  get pid(): number {
    return this.child!.pid!;
  }

  /** Starts it on a free port, or again on the port that it had. */
  async start(): Promise<void> {
    const port = this.url === "" ? "0" : new URL(this.url).port;
    const folders = ["--logs", this.logs, "--terrains", this.terrains];
    const args = ["serve", "--demo", "--port", port, ...folders, ...this.more];
    this.child = begin(args, this.by(this.logs));
    this.url = await said(this.child, /http:\/\/127\.0\.0\.1:\d+/);
  }

  async stop(): Promise<void> {
    const child = this.child;
    this.child = null;
    await kill(child);
  }

  /** Ends it and leaves nothing behind. */
  async dispose(): Promise<void> {
    await this.stop();
    rmSync(this.folder, { recursive: true, force: true });
  }

  async get<T>(path: string): Promise<T> {
    return (await fetch(`${this.url}/api/v1/${path}`)).json() as Promise<T>;
  }

  /** Asks for something; the status of the answer, and what it says. */
  async ask(method: string, path: string, body: unknown): Promise<[number, unknown]> {
    const answer = await fetch(`${this.url}/api/v1/${path}`, {
      method,
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
    });
    return [answer.status, await answer.json()];
  }

  /** The same delay (s) each way, and what else the link is to do. */
  async setDelay(delay_s: number, more: object = {}): Promise<void> {
    const link = { up_delay_s: delay_s, down_delay_s: delay_s, ...more };
    const [status, said] = await this.ask("PUT", "link", link);
    if (status !== 200) throw new Error(`PUT /link answered ${status}: ${JSON.stringify(said)}`);
  }
}
