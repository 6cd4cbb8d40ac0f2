// Listens for everything that a page must not do: errors on its console, exceptions, failed requests.

import type { Page } from "@playwright/test";

/** Requests that the console itself takes back when their answer is no longer wanted. */
const TAKEN_BACK =
  /\/cell\?|\/analysis\/(reachability(\/cell)?|plan|posture|stability)$|\/cameras\/coverage$|\/tiles\//;

export class Watch {
  private readonly wrong: string[] = [];
  private provoked: RegExp[] = [];

  constructor(page: Page) {
    page.on("console", (message) => {
      if (message.type() === "error") this.note(`console: ${message.text()}`);
    });
    page.on("pageerror", (error) => this.note(`exception: ${error.stack ?? error.message}`));
    page.on("requestfailed", (request) => {
      const why = request.failure()?.errorText ?? "no reason";
      if (why === "net::ERR_ABORTED" && TAKEN_BACK.test(request.url())) return;
      this.note(`request: ${request.method()} ${request.url()}: ${why}`);
    });
    page.on("response", (response) => {
      if (response.status() < 400) return;
      this.note(`answer: ${response.status()} to ${response.request().method()} ${response.url()}`);
    });
  }

  /** From here on the test itself provokes what matches. */
  provoke(...patterns: RegExp[]): void {
    this.provoked = patterns;
  }

  /** What went wrong so far. */
  found(): string[] {
    return this.wrong;
  }

  private note(what: string): void {
    if (!this.provoked.some((pattern) => pattern.test(what))) this.wrong.push(what);
  }
}
