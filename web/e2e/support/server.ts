// The ground server that a test starts for itself: the demo mission with the simulated rover.

import type { ChildProcess } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { PROJECT } from "./files";
import { begin, kill, said } from "./program";

export class GroundServer {
  private readonly folder = mkdtempSync(join(tmpdir(), "footfall-e2e-"));
  readonly logs = join(this.folder, "logs");
  readonly terrains = join(this.folder, "terrains");
  url = "";
  private child: ChildProcess | null = null;

  /**
   * With these more arguments; with a configuration instead of that of the demo; `by` gives the program that
   * starts it, from the folder of its logs.
   */
  constructor(
    private readonly more: readonly string[] = [],
    private readonly config: string | null = null,
    private readonly by: (logs: string) => readonly string[] = () => [],
  ) {}

  get pid(): number {
    return this.child!.pid!;
  }

  /** Starts it on a free port, or again on the port that it had. */
  async start(): Promise<void> {
    const port = this.url === "" ? "0" : new URL(this.url).port;
    const folders = ["--logs", this.logs, "--terrains", this.terrains];
    const mission = this.config === null ? ["--demo"] : ["--config", this.written(this.config)];
    const args = ["serve", ...mission, "--port", port, ...folders, ...this.more];
    this.child = begin(args, this.by(this.logs));
    this.url = await said(this.child, /http:\/\/127\.0\.0\.1:\d+/);
  }

  private written(config: string): string {
    const path = join(this.folder, "mission.toml");
    writeFileSync(path, config);
    return path;
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

/** The demo's configuration with other values (as TOML writes them) of keys that occur once in it. */
export function configWith(values: Record<string, string>): string {
  const demo = readFileSync(join(PROJECT, "config/demo.toml"), "utf8");
  return Object.entries(values).reduce((text, [key, value]) => {
    const line = new RegExp(`^${key} = .*$`, "m");
    if (!line.test(text)) throw new Error(`config/demo.toml has no ${key}`);
    return text.replace(line, `${key} = ${value}`);
  }, demo);
}
