// What the dialog's fields say, and the request that follows from them.

import type { ImportRequest } from "../../api/types";
import { DEG } from "../../lib/format";

export interface ImportDraft {
  source: "file" | "recipe";
  file: string;
  recipe: string;
  width: string;
  resolution: string;
  seed: string;
  crop: boolean;
  cropWidth: string;
  cropX: string;
  cropY: string;
  detail: boolean;
  detailResolution: string;
  placeX: string;
  placeY: string;
  heading: string;
}

export const EMPTY_DRAFT: ImportDraft = {
  source: "file",
  file: "",
  recipe: "boulder_field",
  width: "40",
  resolution: "0.05",
  seed: "7",
  crop: false,
  cropWidth: "60",
  cropX: "",
  cropY: "",
  detail: false,
  detailResolution: "0.05",
  placeX: "",
  placeY: "",
  heading: "0",
};

/** The request, or a sentence that says what is missing. */
export function requestOf(draft: ImportDraft): ImportRequest | string {
  const seed = Number(draft.seed);
  if (draft.seed === "" || !Number.isInteger(seed) || seed < 0)
    return "The seed is a whole number.";
  const heading = Number(draft.heading);
  if (draft.heading === "" || !Number.isFinite(heading))
    return "The heading is a number of degrees.";
  const request: ImportRequest = { seed, heading_rad: heading / DEG };
  const place = pair(draft.placeX, draft.placeY);
  if (place === "bad") return "A place needs both x and y.";
  if (place) request.place_m = place;
  if (draft.source === "recipe") {
    const [width_m, resolution_m] = [Number(draft.width), Number(draft.resolution)];
    if (!(width_m > 0) || !(resolution_m > 0)) return "Width and resolution are positive.";
    return { ...request, recipe: { name: draft.recipe, width_m, resolution_m } };
  }
  if (draft.file === "") return "Choose a file.";
  request.file = draft.file;
  if (draft.crop) {
    const center = pair(draft.cropX, draft.cropY);
    if (center === "bad") return "A middle needs both x and y.";
    const width_m = Number(draft.cropWidth);
    if (!(width_m > 0)) return "The width of the part is positive.";
    request.crop = center ? { width_m, center_m: center } : { width_m };
  }
  if (draft.detail) {
    const resolution = Number(draft.detailResolution);
    if (!(resolution > 0)) return "The resolution of the detail is positive.";
    request.detail_resolution_m = resolution;
  }
  return request;
}

/** Both numbers, neither (null), or something else. */
function pair(x: string, y: string): [number, number] | null | "bad" {
  if (x === "" && y === "") return null;
  const both: [number, number] = [Number(x), Number(y)];
  return x !== "" && y !== "" && both.every(Number.isFinite) ? both : "bad";
}
