import type { DryRun } from "../../api/types";
import type { Status } from "../../store/causes";

export type Outcome = DryRun["checks"][number]["outcome"];
export type CheckName = DryRun["checks"][number]["check"];

export const OUTCOME_MARKS: Record<Outcome, Status> = {
  passed: "normal",
  waits: "standby",
  failed: "critical",
  not_reached: "off",
};

export const OUTCOME_WORDS: Record<Outcome, string> = {
  passed: "would be begun",
  waits: "waits",
  failed: "refused",
  not_reached: "not looked at",
};

export const CHECK_WORDS: Record<CheckName, string> = {
  content: "Values, limits and forecast",
  log: "Flight log",
  estop: "No E-stop in force",
  connection: "Connection to the rover",
  rover: "Rover idle",
  authority: "Authority to command",
  order: "Order, no other command armed",
  approval: "Second person",
  preconditions: "Conditions",
};
