// What each key does, for the sheet; the keys themselves are in useHotkeys.

export const KEYS: [string[], string][] = [
  [["F9", "Ctrl + ."], "E-stop"],
  [["1", "…", "6"], "Choose a leg"],
  [["←", "→", "↑", "↓"], "Move the pick by 5 cm (Shift: 25 cm)"],
  [["Enter"], "Plan a step to the pick"],
  [["Esc"], "Drop the pick, then the leg"],
  [["h"], "Plan follows the pointer, or not"],
  [["p"], "Play or hold the preview"],
  [["o"], "Next overlay"],
  [["r"], "Reachability, or not"],
  [["m"], "Map and cameras"],
  [["v"], "Next view: side, top, leg"],
  [["f"], "Fit the rover"],
  [["g"], "Wheel forces"],
  [["t"], "Joint torques as color"],
  [["space"], "Hold or go on with a replay"],
  [["?"], "This sheet"],
];
