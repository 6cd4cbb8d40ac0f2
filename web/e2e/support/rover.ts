// The simulated rover as a process of its own.

import { type ChildProcess, spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { BINARY } from "./server";

export class RoverProcess {
  private readonly state = mkdtempSync(join(tmpdir(), "footfall-rover-"));
  private listen = "127.0.0.1:0";
  private child: ChildProcess | null = null;

  get url(): string {
    return `tcp://${this.listen}`;
  }

  /** Starts it, again where it listened before. */
  async start(): Promise<void> {
    const child = spawn(BINARY, ["rover-sim", "--listen", this.listen, "--state", this.state], {
      stdio: ["ignore", "ignore", "pipe"],
    });
    this.child = child;
    this.listen = await new Promise<string>((resolve, reject) => {
      let said = "";
      child.stderr.on("data", (chunk: Buffer) => {
        said += chunk.toString();
        const address = /tcp:\/\/([\d.]+:\d+)/.exec(said);
        if (address) resolve(address[1]!);
      });
      child.once("error", (error) => reject(new Error(`${BINARY}: ${error.message}`)));
      child.once("exit", (code) => reject(new Error(`${BINARY} ended with ${code}: ${said}`)));
    });
  }

  /** It neither hears nor says anything for a while, and nobody is told. */
  freeze(frozen: boolean): void {
    this.child?.kill(frozen ? "SIGSTOP" : "SIGCONT");
  }

  async kill(): Promise<void> {
    const child = this.child;
    this.child = null;
    if (!child || child.exitCode !== null) return;
    const ended = new Promise((resolve) => child.once("exit", resolve));
    child.kill("SIGKILL");
    await ended;
  }

  async dispose(): Promise<void> {
    await this.kill();
    rmSync(this.state, { recursive: true, force: true });
  }
}
