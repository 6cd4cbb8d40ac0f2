// The connection between the ground server and a rover that is a process of its own.

import type { CarrierReport } from "../api/types";
import type { Channels } from "./streamState";

/** The connection to the rover where it is not up, else null. */
export function carrierDown(channels: Channels): CarrierReport | null {
  const carrier = channels.link?.message.carrier;
  return carrier && carrier.state !== "up" ? carrier : null;
}

const WORDS: Record<CarrierReport["state"], string> = {
  up: "up",
  connecting: "connecting for the first time",
  reconnecting: "down, reconnecting",
  refused: "refused",
};

/** How it is, in words. */
export function carrierWords(carrier: CarrierReport): string {
  return `Rover link ${WORDS[carrier.state]}`;
}
