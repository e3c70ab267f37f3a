/* The findings of the filter as a table; a row leads to its finding. More rows come as one scrolls. */

import { fill, h } from "./dom.js";
import { mark } from "./marks.js";
import { number, percent, say } from "./words.js";

export class List {
  /** @param {{hrefOf: (id: string) => string}} options */
  constructor(place, queue, { hrefOf }) {
    this.queue = queue;
    this.hrefOf = hrefOf;
    this.body = h("tbody");
    this.count = h("caption");
    this.end = h("p", { class: "hint" });
    const columns = ["verdict", "title", "road", "confidence", "state"];
    fill(
      place,
      h("table", { class: "findings" }, this.count, h("thead", {}, h("tr", {}, columns.map((column) => h("th", { scope: "col" }, say(`page.column.${column}`))))), this.body),
      this.end,
    );
    new IntersectionObserver((entries) => entries[0].isIntersecting && this.more(), { rootMargin: "400px" }).observe(this.end);
    place.addEventListener("keydown", (event) => this.walk(event));
  }

  show(current) {
    this.body.replaceChildren();
    this.add(this.queue.items);
    this.body.querySelector(`a[data-id="${CSS.escape(current ?? "")}"]`)?.closest("tr").classList.add("current");
  }

  add(items) {
    this.body.append(...items.map((item) => this.row(item)));
    this.count.textContent = say("page.list.count", { shown: number(this.body.rows.length), total: number(this.queue.total) });
    this.end.textContent = this.queue.total === 0 ? say("page.list.none") : "";
  }

  row(item) {
    const state = this.queue.stateOf(item.change_id);
    return h(
      "tr",
      { class: this.queue.isSettled(item.change_id) ? "settled" : "" },
      h("td", {}, h("span", { class: "verdict" }, mark(item.verdict), say(`page.verdict.${item.verdict}`))),
      h("td", {}, h("a", { href: this.hrefOf(item.change_id), "data-id": item.change_id }, item.title)),
      h("td", {}, item.road),
      h("td", { class: "number" }, percent(item.confidence)),
      h("td", {}, say(`page.state.${state}`)),
    );
  }

  async more() {
    if (this.isBusy || this.body.rows.length === 0 || this.queue.items.length >= this.queue.total) return;
    this.isBusy = true;
    const before = this.queue.items.length;
    try {
      await this.queue.more();
      this.add(this.queue.items.slice(before));
    } catch {
      // The page says elsewhere that the server is gone; scrolling asks again.
    } finally {
      this.isBusy = false;
    }
  }

  /** Arrows go from row to row, Enter opens. */
  walk(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const links = step && [...this.body.querySelectorAll("a")];
    const at = links ? links.indexOf(document.activeElement) : -1;
    if (at < 0) return;
    event.preventDefault();
    links[at + step]?.focus();
  }
}
