// Fields of telemetry that a command may wait for: found by name, compared as the rover compares them.

import type { Precondition } from "../api/types";

export type Comparison = Precondition["op"];

export const COMPARISONS: [Comparison, string][] = [
  ["eq", "is"],
  ["ne", "is not"],
  ["lt", "less than"],
  ["le", "at most"],
  ["gt", "greater than"],
  ["ge", "at least"],
];

export const comparisonWords = (op: Comparison) =>
  COMPARISONS.find(([value]) => value === op)?.[1] ?? op;

/** The value at a path of names and indices; undefined where there is none, as where it is null. */
export function fieldOf(message: unknown, path: string): unknown {
  let value: unknown = message;
  for (const name of path.split(".")) {
    if (typeof value !== "object" || value === null) return undefined;
    if (Array.isArray(value) && !/^\d+$/.test(name)) return undefined;
    value = Object.hasOwn(value, name) ? (value as Record<string, unknown>)[name] : undefined;
  }
  return value ?? undefined;
}

export type Scalar = number | string | boolean;

/** What was typed as the value that it stands for: a number, true or false, else a text. */
export function scalarOf(text: string): Scalar | null {
  const bare = text.trim();
  if (bare === "") return null;
  if (bare === "true" || bare === "false") return bare === "true";
  const number = Number(bare);
  return Number.isFinite(number) ? number : bare;
}

/** Does it hold? Null where values of these kinds do not compare so. */
export function holds(found: unknown, op: Comparison, wanted: unknown): boolean | null {
  if (typeof found === "number" && typeof wanted === "number") {
    switch (op) {
      case "eq":
        return found === wanted;
      case "ne":
        return found !== wanted;
      case "lt":
        return found < wanted;
      case "le":
        return found <= wanted;
      case "gt":
        return found > wanted;
      case "ge":
        return found >= wanted;
    }
  }
  const sameKind = typeof found === typeof wanted && ["string", "boolean"].includes(typeof found);
  if (!sameKind || (op !== "eq" && op !== "ne")) return null;
  return (found === wanted) === (op === "eq");
}

const FIELDS_MAX = 600;

/** All paths down to values that compare, in order. */
export function fieldsOf(message: unknown): string[] {
  const found: string[] = [];
  const walk = (value: unknown, path: string) => {
    if (found.length >= FIELDS_MAX) return;
    if (["number", "string", "boolean"].includes(typeof value)) found.push(path);
    else if (typeof value === "object" && value !== null) {
      for (const [name, inner] of Object.entries(value)) {
        walk(inner, path === "" ? name : `${path}.${name}`);
      }
    }
  };
  walk(message, "");
  return found;
}

/** A value for people: short, with few decimals. */
export function shownValue(value: unknown): string {
  if (typeof value === "number") {
    return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(4)));
  }
  if (typeof value === "string" || typeof value === "boolean") return String(value);
  return value === undefined ? "not told" : "no single value";
}

/** `operation.mode is driving`. */
export function preconditionWords({ field, op, value }: Precondition): string {
  return `${field} ${comparisonWords(op)} ${shownValue(value)}`;
}
