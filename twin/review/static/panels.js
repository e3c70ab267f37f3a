/* What opens beside the finding without standing in its way: the filter, the session's answers, the keys. */

import { get } from "./api.js";
import { byId, fill, h } from "./dom.js";
import { number, say, time } from "./words.js";

/** Panels that are open or not, each with its button in the header. */
export class Panels {
  /** @param {Record<string, () => void>} fillers called when a panel opens */
  constructor(fillers) {
    this.fillers = fillers;
    for (const name of Object.keys(fillers)) byId(`open-${name}`).addEventListener("click", () => this.toggle(name));
  }

  toggle(name) {
    const isOpening = byId(name).hidden;
    if (isOpening) for (const other of Object.keys(this.fillers)) this.set(other, other === name);
    else this.set(name, false);
    if (isOpening) this.fillers[name]();
  }

  set(name, isOpen) {
    byId(name).hidden = !isOpen;
    byId(`open-${name}`).setAttribute("aria-expanded", String(isOpen));
  }

  /** Close what is open; whether something was. */
  close() {
    const open = Object.keys(this.fillers).filter((name) => !byId(name).hidden);
    for (const name of open) {
      const held = byId(name).contains(document.activeElement);
      this.set(name, false);
      if (held) byId(`open-${name}`).focus();
    }
    return open.length > 0;
  }
}

/** The answers of this session, newest first, each with the way back to its finding. */
export async function showHistory(place, page) {
  const title = h("h2", { id: "history-title" }, say("page.history.title"));
  const undo = h("button", { type: "button", onclick: () => page.undo().then(() => showHistory(place, page)) }, say("page.answers.undo"));
  const waiting = page.outbox.pending.filter((entry) => !entry.facts.isUndo).reverse();
  let answers = [];
  try {
    answers = (await get("api/session/answers")).items;
  } catch (error) {
    page.onFailure(error);
  }
  const open = (id) => (event) => {
    event.preventDefault();
    page.go({ view: "", id });
  };
  const row = (answer, isWaiting) =>
    h(
      "li",
      { class: answer.decision },
      h("a", { href: page.addressOf({ ...page.filter, id: answer.change_id }), onclick: open(answer.change_id) }, answer.title || answer.change_id),
      h("span", { class: "what" }, say(`page.state.${answer.decision}`), isWaiting ? ` – ${say("page.history.waiting")}` : ""),
      answer.comment && h("q", {}, answer.comment),
      answer.at && h("time", { datetime: answer.at }, time(answer.at)),
    );
  const rows = [
    ...waiting.map(({ body, facts }) => row({ change_id: body.change_id, decision: body.answer, comment: body.comment, title: facts.title }, true)),
    ...answers.map((answer) => row(answer, false)),
  ];
  fill(place, title, rows.length ? [undo, h("ol", { class: "answers-given" }, rows)] : h("p", {}, say("page.history.none")));
}

/** The filter of the queue, kept in the address. */
export function layFilter(form, session, onchange) {
  const every = (key) => ["", say(key)];
  const openOf = (verdict) => session.counts[verdict]?.open ?? 0;
  const choices = {
    verdict: [every("page.filter.every-verdict"), ...Object.keys(session.counts).map((verdict) => [verdict, `${say(`page.verdict.${verdict}`)} (${number(openOf(verdict))})`])],
    state: [["", say("page.state.open")], ...["accept", "dismiss", "defer", ...(session.disagreements ? ["disagreement"] : [])].map((state) => [state, say(`page.state.${state}`)]), ["all", say("page.filter.every-state")]],
    road: [every("page.filter.every-road"), ...session.roads.map((road) => [road, road])],
    drive: [every("page.filter.every-drive"), ...session.drives.map((drive) => [drive.drive_id, [drive.name, drive.date].filter(Boolean).join(", ")])],
    kommune: [every("page.filter.every-kommune"), ...session.kommuner.map((kommune) => [String(kommune.number ?? kommune), String(kommune.name ?? kommune)])],
    order: ["", "confidence", "verdict", "road", "place"].map((order) => [order, say(`page.order.${order || "usual"}`)]),
  };
  const fields = Object.entries(choices)
    .filter(([name, options]) => name === "state" || name === "order" || options.length > 2)
    .map(([name, options]) =>
      h(
        "label",
        {},
        h("span", {}, say(`page.filter.${name}`)),
        h("select", { name, onchange: () => onchange(Object.fromEntries(new FormData(form))) }, options.map(([value, text]) => h("option", { value }, text))),
      ),
    );
  fill(form, fields, h("button", { type: "button", onclick: () => onchange({}) }, say("page.filter.none")));
  form.addEventListener("submit", (event) => event.preventDefault());
  form.show = (filter) => {
    for (const select of form.querySelectorAll("select")) select.value = filter[select.name] ?? "";
    byId("open-filter").classList.toggle("active", Object.keys(filter).length > 0);
  };
}
