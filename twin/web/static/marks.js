/* How verdicts look: the colours and shapes of twin/export/appearance.py (a test compares them). After Okabe and Ito:
   apart for every kind of colour vision; the shape says the same again. */

import { svg } from "./dom.js";

export const MARKS = {
  unchanged: { colour: "#8f93a0", shape: "o" },
  not_observable: { colour: "#56b4e9", shape: "o" },
  review: { colour: "#0072b2", shape: "s" },
  moved: { colour: "#e69f00", shape: "^" },
  wrong_type: { colour: "#aa3377", shape: "D" },
  new: { colour: "#009e73", shape: "P" },
  missing: { colour: "#d55e00", shape: "X" },
};

export const SEEN_COLOUR = "#1b2a41";
export const NVDB_COLOUR = "#5e4fa2";
export const DRIVE_COLOUR = "#5b7083";

// In a square of 24.
const PATHS = {
  o: "M12 4a8 8 0 1 0 0 16a8 8 0 1 0 0-16z",
  s: "M4 4h16v16h-16z",
  "^": "M12 2l10 19h-20z",
  D: "M12 1l11 11l-11 11l-11-11z",
  P: "M8.5 2h7v6.5h6.5v7h-6.5v6.5h-7v-6.5h-6.5v-7h6.5z",
  X: "M7 2l5 5l5-5l5 5l-5 5l5 5l-5 5l-5-5l-5 5l-5-5l5-5l-5-5z",
};

/** The mark of a verdict as a small picture; its name stands beside it in words. */
export function mark(verdict) {
  const { colour, shape } = MARKS[verdict] ?? MARKS.unchanged;
  return svg(
    "svg",
    { class: "mark", viewBox: "0 0 24 24", width: 18, height: 18, "aria-hidden": "true" },
    svg("path", { d: PATHS[shape], fill: colour, stroke: "#ffffff", "stroke-width": 1.2 }),
  );
}

/** Pixels of a shape for the map: drawn here, so that no file is asked for. */
export function pixels(path, fill, size, { stroke = "#ffffff", width = 1.6 } = {}) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = size;
  const brush = canvas.getContext("2d", { willReadFrequently: true });
  brush.scale(size / 28, size / 28);
  brush.translate(2, 2);
  const outline = new Path2D(path);
  brush.lineJoin = "round";
  brush.fillStyle = fill;
  brush.strokeStyle = stroke;
  brush.lineWidth = width;
  if (stroke) brush.stroke(outline);
  brush.fill(outline);
  return brush.getImageData(0, 0, size, size);
}

export const pathOf = (verdict) => PATHS[(MARKS[verdict] ?? MARKS.unchanged).shape];
