// Asks for the latest of a stream of questions: one at a time, not too often, the last one wins.

export interface LatestOptions<Q, A> {
  ask: (question: Q, signal: AbortSignal) => Promise<A>;
  /** Told of each answer and of each failure that was not a taking back. */
  answered: (question: Q, answer: A) => void;
  failed: (question: Q, error: unknown) => void;
  /** Told when the last answer has been out of date for `late_ms`, and when it no longer is. */
  late: (late: boolean) => void;
  /** Least time between the beginnings of two requests (ms). */
  interval_ms: number;
  late_ms: number;
  /** How long nothing is asked after a failure (ms). */
  pause_ms: number;
  now?: () => number;
}

export class Latest<Q, A> {
  private wanted: Q | null = null;
  private flight: AbortController | null = null;
  private next: ReturnType<typeof setTimeout> | undefined;
  private lateAfter: ReturnType<typeof setTimeout> | undefined;
  private isLate = false;
  /** Nothing is asked before then. */
  private notBefore = -Infinity;
  private readonly now: () => number;

  constructor(private readonly options: LatestOptions<Q, A>) {
    this.now = options.now ?? (() => performance.now());
  }

  /** Asks for this as soon as may be; what waited to be asked is forgotten. */
  want(question: Q): void {
    this.wanted = question;
    this.lateAfter ??= this.lateTimer();
    if (!this.flight) this.schedule();
  }

  /** Wants nothing any more: what is under way is taken back and its answer dropped. */
  stop(): void {
    this.wanted = null;
    this.flight?.abort();
    this.flight = null;
    clearTimeout(this.next);
    this.next = undefined;
    this.inTime();
  }

  private schedule(): void {
    if (this.next !== undefined) return;
    const wait = this.notBefore - this.now();
    if (wait <= 0) this.send();
    else {
      this.next = setTimeout(() => {
        this.next = undefined;
        this.send();
      }, wait);
    }
  }

  private send(): void {
    const question = this.wanted;
    if (question === null) return;
    this.wanted = null;
    const mine = new AbortController();
    this.flight = mine;
    this.notBefore = this.now() + this.options.interval_ms;
    const end = (tell: () => void) => {
      if (this.flight !== mine) return;
      this.flight = null;
      clearTimeout(this.lateAfter);
      // While answers keep coming none of them is late, and one that is late stays so until the last.
      if (this.wanted === null) this.inTime();
      else this.lateAfter = this.lateTimer();
      tell();
      // The listener may have asked or stopped.
      if (this.wanted !== null && !this.flight) this.schedule();
    };
    this.options.ask(question, mine.signal).then(
      (answer) => end(() => this.options.answered(question, answer)),
      (error: unknown) =>
        end(() => {
          this.notBefore = this.now() + this.options.pause_ms;
          this.options.failed(question, error);
        }),
    );
  }

  private lateTimer() {
    return setTimeout(() => this.tellLate(true), this.options.late_ms);
  }

  private inTime(): void {
    clearTimeout(this.lateAfter);
    this.lateAfter = undefined;
    this.tellLate(false);
  }

  private tellLate(late: boolean): void {
    if (late === this.isLate) return;
    this.isLate = late;
    this.options.late(late);
  }
}
