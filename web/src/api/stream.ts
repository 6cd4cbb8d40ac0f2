// The stream: one socket, opened again with growing pauses when it is lost, watched by pings.

import type { StreamFrame, StreamRequest } from "./types";

export interface StreamHandlers {
  /** Frames in order of arrival, gathered so that listeners work at most 20 times a second. */
  onFrames(frames: StreamFrame[]): void;
  onOpen(): void;
  /** The socket is gone; the next attempt is in `retry_ms`. */
  onLost(retry_ms: number): void;
  onPong(server_time: string, sent_local_ms: number, received_local_ms: number): void;
}

const GATHER_MS = 50;
const PING_MS = 5000;
const SILENCE_MS = 12_000;
const FIRST_RETRY_MS = 500;
const LAST_RETRY_MS = 8000;

export class Stream {
  private socket: WebSocket | null = null;
  private gathered: StreamFrame[] = [];
  private gatherTimer = 0;
  private retryTimer = 0;
  private pingTimer = 0;
  private retry_ms = FIRST_RETRY_MS;
  private lastHeard = 0;
  private pings = new Map<number, number>();
  private nonce = 0;
  private closed = false;

  constructor(
    private readonly url: string,
    private readonly handlers: StreamHandlers,
  ) {
    this.connect();
  }

  send(request: StreamRequest): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }

  /** Tries again at once instead of at the next attempt. */
  retryNow(): void {
    if (this.socket === null && !this.closed) {
      clearTimeout(this.retryTimer);
      this.connect();
    }
  }

  close(): void {
    this.closed = true;
    clearTimeout(this.retryTimer);
    clearTimeout(this.gatherTimer);
    clearInterval(this.pingTimer);
    this.socket?.close();
  }

  private connect(): void {
    const socket = new WebSocket(this.url);
    this.socket = socket;
    socket.onmessage = (event) => this.receive(String(event.data));
    socket.onopen = () => {
      this.retry_ms = FIRST_RETRY_MS;
      this.lastHeard = performance.now();
      this.pings.clear();
      this.handlers.onOpen();
      this.ping();
      this.pingTimer = window.setInterval(() => this.watch(), PING_MS);
    };
    socket.onclose = () => this.lost(socket);
    socket.onerror = () => socket.close();
  }

  private lost(socket: WebSocket): void {
    if (this.socket !== socket) return;
    this.socket = null;
    clearInterval(this.pingTimer);
    if (this.closed) return;
    this.flush();
    const wait_ms = this.retry_ms;
    this.retry_ms = Math.min(this.retry_ms * 1.7, LAST_RETRY_MS);
    this.handlers.onLost(wait_ms);
    this.retryTimer = window.setTimeout(() => this.connect(), wait_ms);
  }

  private watch(): void {
    const socket = this.socket;
    if (socket && performance.now() - this.lastHeard > SILENCE_MS) {
      socket.close();
      // A dead network never answers the close: count it as lost now.
      this.lost(socket);
    } else {
      this.ping();
    }
  }

  private ping(): void {
    this.nonce = (this.nonce + 1) % 0xffff_ffff;
    if (this.pings.size > 8) this.pings.clear();
    this.pings.set(this.nonce, localNow());
    this.send({ op: "ping", nonce: this.nonce });
  }

  private receive(text: string): void {
    this.lastHeard = performance.now();
    let frame: StreamFrame;
    try {
      frame = JSON.parse(text) as StreamFrame;
    } catch {
      return;
    }
    if (frame.op === "pong") {
      const sent = this.pings.get(frame.nonce);
      this.pings.delete(frame.nonce);
      if (sent !== undefined) this.handlers.onPong(frame.now, sent, localNow());
      return;
    }
    this.gathered.push(frame);
    if (this.gatherTimer === 0) {
      this.gatherTimer = window.setTimeout(() => this.flush(), GATHER_MS);
    }
  }

  private flush(): void {
    clearTimeout(this.gatherTimer);
    this.gatherTimer = 0;
    const frames = this.gathered;
    this.gathered = [];
    if (frames.length > 0) this.handlers.onFrames(frames);
  }
}

/** Local time (ms since 1970) that never jumps while the page is open. */
export function localNow(): number {
  return performance.timeOrigin + performance.now();
}
