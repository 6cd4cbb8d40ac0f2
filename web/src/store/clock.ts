// What time it is on the server, estimated from `hello` and from pings.

import { localNow } from "../api/stream";

export interface ClockEstimate {
  /** Server time minus local time (ms). */
  offset_ms: number;
  /** Round trip that the estimate rests on (ms); infinite before the first pong. */
  round_trip_ms: number;
}

export const NO_ESTIMATE: ClockEstimate = { offset_ms: 0, round_trip_ms: Infinity };

/** A `hello` gives a first estimate that any pong beats. */
export function withHello(estimate: ClockEstimate, server_ms: number, local_ms: number) {
  if (Number.isFinite(estimate.round_trip_ms) || Number.isNaN(server_ms)) return estimate;
  return { offset_ms: server_ms - local_ms, round_trip_ms: Infinity };
}

/** The estimate of the shortest round trip wins; old ones age so that drift is followed. */
export function withPong(
  estimate: ClockEstimate,
  server_ms: number,
  sent_ms: number,
  received_ms: number,
): ClockEstimate {
  const round_trip_ms = Math.max(0, received_ms - sent_ms);
  if (Number.isNaN(server_ms)) return estimate;
  if (round_trip_ms > estimate.round_trip_ms * 1.2 + 1) {
    return { ...estimate, round_trip_ms: estimate.round_trip_ms * 1.2 + 1 };
  }
  return { offset_ms: server_ms - (sent_ms + received_ms) / 2, round_trip_ms };
}

let estimate = NO_ESTIMATE;

export function noteHello(server_ms: number): void {
  estimate = withHello(estimate, server_ms, localNow());
}

export function notePong(server_ms: number, sent_ms: number, received_ms: number): void {
  estimate = withPong(estimate, server_ms, sent_ms, received_ms);
}

/** Server time now (ms since 1970). */
export function serverNow(): number {
  return localNow() + estimate.offset_ms;
}
