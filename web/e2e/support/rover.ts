// The simulated rover as a process of its own.

import type { ChildProcess } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { begin, kill, said } from "./program";

export class RoverProcess {
  private readonly state = mkdtempSync(join(tmpdir(), "footfall-rover-"));
  private listen = "127.0.0.1:0";
  private child: ChildProcess | null = null;

  get url(): string {
    return `tcp://${this.listen}`;
  }

  /** Starts it, again where it listened before. */
  async start(): Promise<void> {
    const args = ["rover-sim", "--listen", this.listen, "--state", this.state];
    this.child = begin(args);
    this.listen = (await said(this.child, /tcp:\/\/[\d.]+:\d+/)).slice("tcp://".length);
  }

  /** It neither hears nor says anything for a while, and nobody is told. */
  freeze(frozen: boolean): void {
    this.child?.kill(frozen ? "SIGSTOP" : "SIGCONT");
  }

  async kill(): Promise<void> {
    const child = this.child;
    this.child = null;
    await kill(child);
  }

  async dispose(): Promise<void> {
    await this.kill();
    rmSync(this.state, { recursive: true, force: true });
  }
}
