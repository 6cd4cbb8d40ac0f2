// What the commands that are staged next are to wait for: of the plan, and by hand.

import { create } from "zustand";

import type { Precondition } from "../api/types";

export const useConditions = create<Record<"plan" | "hand", Precondition[]>>(() => ({
  plan: [],
  hand: [],
}));
