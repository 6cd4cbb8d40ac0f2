// A small disk for the logs of a server, that can be filled: a tmpfs that this process alone sees.

import { spawnSync } from "node:child_process";
import { closeSync, mkdirSync, openSync, rmSync, writeSync } from "node:fs";
import { join } from "node:path";

const SIZE = "128m";
const MIB = 1 << 20;

/** As root, or in a user namespace where the system grants one. */
const WAYS = [
  ["unshare", "-m"],
  ["unshare", "-Urm"],
];

/** How a process gets a disk of its own here; null where it cannot. */
export function wayToMount(): readonly string[] | null {
  const tried = (way: string[]) =>
    spawnSync(way[0]!, [...way.slice(1), "mount", "-t", "tmpfs", "tmpfs", "/mnt"]).status === 0;
  return WAYS.find(tried) ?? null;
}

/** The program that starts another one with the small disk at `folder`. */
export function onSmallDisk(way: readonly string[], folder: string): readonly string[] {
  mkdirSync(folder, { recursive: true });
  const script = `mount -t tmpfs -o size=${SIZE} tmpfs "$1" && shift && exec "$@"`;
  return [...way, "sh", "-c", script, "sh", folder];
}

/** What somebody else puts on the disk of process `pid`, to its last byte. */
export class Filler {
  private readonly path: string;

  constructor(pid: number, folder: string) {
    this.path = join(`/proc/${pid}/root`, folder, "filler");
  }

  /** Writes until nothing more is taken. */
  fill(): void {
    const file = openSync(this.path, "w");
    try {
      for (let size = MIB; size >= 1;) {
        try {
          writeSync(file, Buffer.alloc(size));
        } catch (error) {
          if ((error as NodeJS.ErrnoException).code !== "ENOSPC") throw error;
          size = size > 1 ? size / 16 : 0;
        }
      }
    } finally {
      closeSync(file);
    }
  }

  remove(): void {
    rmSync(this.path, { force: true });
  }
}
