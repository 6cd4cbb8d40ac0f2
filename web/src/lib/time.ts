// Times on screen: UTC, 24 h, day of year. Inside: milliseconds since 1970 as a number.

/** Milliseconds of an RFC 3339 UTC time, with its decimals; NaN if it is none. */
export function parseTime(text: string): number {
  const match = /^(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?Z$/.exec(text);
  if (!match) return NaN;
  return Date.parse(`${match[1]}Z`) + Math.round(Number(match[2] ?? 0) * 1e9) / 1e6;
}

export function parseOptional(text: string | null | undefined): number | null {
  const time = text == null ? NaN : parseTime(text);
  return Number.isNaN(time) ? null : time;
}

/** RFC 3339 text of a time, with milliseconds. */
export function toRfc3339(ms: number): string {
  return new Date(ms).toISOString();
}

/** Day of the year in UTC, 1 to 366. */
export function dayOfYear(ms: number): number {
  const date = new Date(ms);
  const start = Date.UTC(date.getUTCFullYear(), 0, 1);
  return Math.floor((ms - start) / 86_400_000) + 1;
}

const two = (n: number) => String(n).padStart(2, "0");

/** `15:04:05`, or `15:04:05.1` with tenths. */
export function formatClock(ms: number, tenths = false): string {
  if (!Number.isFinite(ms)) return "--:--:--";
  const date = new Date(ms);
  const clock = `${two(date.getUTCHours())}:${two(date.getUTCMinutes())}:${two(date.getUTCSeconds())}`;
  return tenths ? `${clock}.${Math.floor(date.getUTCMilliseconds() / 100)}` : clock;
}

/** `2026-327`: year and day of year. */
export function formatDay(ms: number): string {
  if (!Number.isFinite(ms)) return "----";
  return `${new Date(ms).getUTCFullYear()}-${String(dayOfYear(ms)).padStart(3, "0")}`;
}

/** `2026-327T15:04:05.1Z`. */
export function formatDayTime(ms: number): string {
  return `${formatDay(ms)}T${formatClock(ms, true)}Z`;
}

/** A span for people: `1.3 s`, `2:05`, `1:00:07`. Negative spans count as zero. */
export function formatSpan(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const s = Math.max(0, seconds);
  // 99.95 and more would round to 100.0 s.
  if (s < 99.95) return `${s.toFixed(1)} s`;
  const whole = Math.round(s);
  const [h, m] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return h > 0 ? `${h}:${two(m)}:${two(whole % 60)}` : `${m}:${two(whole % 60)}`;
}

/** How long ago, in whole units that do not jitter: `33 s`, `5 min`, `2 h`, `3 d`. */
export function formatAge(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const s = Math.max(0, Math.round(seconds));
  if (s < 100) return `${s} s`;
  if (s < 6000) return `${Math.round(s / 60)} min`;
  return s < 172_800 ? `${Math.round(s / 3600)} h` : `${Math.round(s / 86_400)} d`;
}
