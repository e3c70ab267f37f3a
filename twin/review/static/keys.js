/* Keys: a bare letter acts, Shift is its "with a comment". Nothing acts while somebody types, nor when a key is held. */

import { byId, fill, h, isTyping } from "./dom.js";
import { say } from "./words.js";

const SWITCH = "twin-review-keys";
const ANSWERS = { a: "accept", d: "dismiss", s: "defer", t: "temporary" };

/** Keys in the order of the help panel. */
const HELP = [
  ["A", "accept"],
  ["D", "dismiss"],
  ["S", "defer"],
  ["T", "temporary"],
  ["⇧ A D S T", "comment"],
  ["U", "undo"],
  ["J K ← →", "browse"],
  ["1 2 3", "pictures"],
  ["C", "field"],
  ["L", "list"],
  ["M", "map"],
  ["F", "filter"],
  ["H", "history"],
  ["?", "help"],
  ["Esc", "escape"],
];

const areOn = () => localStorage.getItem(SWITCH) !== "off";

export function listenToKeys(page) {
  const acts = {
    u: () => page.undo(),
    j: () => page.browse(1),
    k: () => page.browse(-1),
    ArrowRight: () => page.browse(1),
    ArrowLeft: () => page.browse(-1),
    l: () => page.toggle("list"),
    m: () => page.toggle("map"),
    f: () => page.panels.toggle("filter"),
    h: () => page.panels.toggle("history"),
    "?": () => page.panels.toggle("help"),
  };
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") return escape(event, page);
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || isTyping(event.target) || !areOn()) return undefined;
    const isOnMap = event.target instanceof Element && event.target.closest(".maplibregl-map") && event.key.startsWith("Arrow");
    if (isOnMap) return undefined;
    const isOnFinding = document.body.dataset.view === "finding";
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const act = (isOnFinding && ofFinding(page, key, event.shiftKey)) || acts[key];
    if (!act) return undefined;
    event.preventDefault();
    return act();
  });
}

function ofFinding(page, key, isShift) {
  const answer = ANSWERS[key];
  if (answer) return () => (isShift ? page.answers.giveWithComment(answer) : page.answers.give(answer));
  if ("123".includes(key)) return () => byId("pictures")?.choose?.(Number(key) - 1);
  if (key === "c") return () => page.answers.comment?.focus();
  return null;
}

function escape(event, page) {
  if (isTyping(event.target)) page.answers.leave();
  else if (!page.panels.close() && document.body.dataset.view !== "finding") page.go({ view: "" });
}

export function layHelp(place) {
  const box = h("input", { type: "checkbox", id: "keys-on", onchange: () => localStorage.setItem(SWITCH, box.checked ? "on" : "off") });
  box.checked = areOn();
  fill(
    place,
    h("h2", { id: "help-title" }, say("page.help.title")),
    h("dl", { class: "keys" }, HELP.map(([keys, act]) => h("div", {}, h("dt", {}, keys.split(" ").map((key) => h("kbd", {}, key))), h("dd", {}, say(`page.key.${act}`))))),
    h("p", {}, h("label", { class: "switch" }, box, " ", say("page.help.switch"))),
    h("p", { class: "hint" }, say("page.help.words")),
  );
}
