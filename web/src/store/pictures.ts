// The capture whose pictures are looked at.

import { create } from "zustand";

import type { VersionPair } from "../api/types";

export const usePictures = create<{ of: VersionPair | null }>(() => ({ of: null }));

export function showPictures(of: VersionPair | null): void {
  usePictures.setState({ of });
}
