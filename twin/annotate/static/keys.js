/* Keys: a bare letter acts, Shift is its "more". Nothing acts while somebody types. */

import { byId, fill, h, isTyping } from "./dom.js";
import { say } from "./words.js";

const HELP = [
  ["← →", "step"],
  ["Enter", "confirm"],
  ["F", "foot"],
  ["B", "box"],
  ["+", "new"],
  ["N", "offer"],
  ["K", "code"],
  ["C", "camera"],
  ["J", "sign"],
  ["X", "remove"],
  ["U Z", "undo"],
  ["?", "help"],
  ["Esc", "escape"],
];

const ACTS = { f: "foot", b: "box", "+": "new", n: "offer", k: "code", c: "camera", j: "sign", x: "remove", u: "undo", z: "undo", "?": "help", Enter: "confirm" };

export function listenToKeys(acts) {
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") return acts.escape();
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return undefined;
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      event.preventDefault();
      return acts.step((event.key === "ArrowRight" ? 1 : -1) * (event.shiftKey ? 10 : 1));
    }
    // What begins with a digit is a code: it is typed into the field, which has what stands there selected.
    if (/^\d$/.test(event.key)) return acts.code();
    const isButton = event.target instanceof HTMLButtonElement;
    const act = ACTS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act || event.repeat || (event.key === "Enter" && isButton)) return undefined;
    event.preventDefault();
    return acts[act]();
  });
}

export function layHelp() {
  fill(
    byId("help"),
    h("h2", { id: "help-title" }, say("annotate.help.title")),
    h("dl", { class: "keys" }, HELP.map(([keys, act]) => h("div", {}, h("dt", {}, keys.split(" ").map((key) => h("kbd", {}, key))), h("dd", {}, say(`annotate.key.${act}`))))),
  );
}
