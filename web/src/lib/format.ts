// Numbers with units and fixed decimals. Radians become degrees here and nowhere else.

export const DEG = 180 / Math.PI;

export function metres(value: number | null | undefined, decimals = 2): string {
  return value == null || !Number.isFinite(value) ? "–" : `${signless(value, decimals)} m`;
}

export function degrees(rad: number | null | undefined, decimals = 1): string {
  return rad == null || !Number.isFinite(rad) ? "–" : `${signless(rad * DEG, decimals)}°`;
}

export function percent(share: number | null | undefined): string {
  return share == null || !Number.isFinite(share) ? "–" : `${Math.round(share * 100)} %`;
}

export function newtons(value: number): string {
  return Number.isFinite(value) ? `${Math.round(value)} N` : "–";
}

export function fileSize(bytes: number): string {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Fixed decimals with a true minus sign, and no minus before a zero. */
export function signless(value: number, decimals: number): string {
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

/** `leg2` → `leg 2`; other names stay. */
export function legLabel(leg: string): string {
  return leg.replace(/^leg(\d+)$/, "leg $1");
}

export function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** A sentence of the server with its identifiers as words: `leg2_hip_pitch_link` → `leg 2 hip pitch`. */
export function readable(text: string): string {
  return text
    .replace(/\bleg(\d+)(?=_|\b)/g, "leg $1")
    .replace(/(?<=[a-z0-9])_link\b/g, "")
    .replace(/(?<=[a-z0-9])_(?=[a-z0-9])/g, " ");
}

/** Words of an identifier of the server: `no_path` → `no path`. */
export function words(identifier: string): string {
  return identifier.replaceAll("_", " ");
}
