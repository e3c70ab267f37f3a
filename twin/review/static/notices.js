/* What the page says by itself: progress, modes, a lost server, a finding that changed meanwhile. */

import { Refused } from "./api.js";
import { fill, h } from "./dom.js";
import { mark, MARKS } from "./marks.js";
import { number, say } from "./words.js";

export class Notices {
  constructor(place) {
    this.place = place;
  }

  /** The server is gone, or no longer takes this page's cookie: one notice, which stays until it is back. */
  lost(pending, error, retry) {
    const isShut = error instanceof Refused && error.status === 403;
    const sentence = isShut ? say("page.lost.shut") : error.message || say("page.lost.gone");
    const kept = pending > 0 ? say("page.lost.kept", { count: number(pending) }) : "";
    this.outage ??= h("div", { class: "notice lost", role: "alert" });
    fill(this.outage, h("p", {}, h("strong", {}, sentence), " ", kept), retry && h("button", { type: "button", onclick: retry }, say("page.lost.retry")));
    this.outage.dataset.pending = String(pending);
    if (!this.outage.isConnected) this.place.append(this.outage);
  }

  reachable() {
    this.outage?.remove();
    this.outage = null;
  }

  /** What the server says of itself: why nothing can be answered now. */
  standing(sentence) {
    this.place.append(h("p", { class: "notice", role: "status" }, sentence));
  }

  /** An answer that the server did not take, with the way back to its question. */
  refused(title, sentence, open) {
    const notice = h("div", { class: "notice", role: "alert" });
    fill(
      notice,
      h("p", {}, title && h("strong", {}, `${title} `), sentence),
      open && h("button", { type: "button", onclick: () => (notice.remove(), open()) }, say("page.refused.open")),
      h("button", { type: "button", onclick: () => notice.remove() }, say("page.refused.close")),
    );
    this.place.append(notice);
  }
}

/** How much is settled, verdict by verdict. */
export function showProgress(place, counts) {
  const rows = Object.keys(MARKS)
    .reverse()
    .filter((verdict) => counts[verdict])
    .map((verdict) => {
      const { open = 0, accept = 0, dismiss = 0, defer = 0 } = counts[verdict];
      return { verdict, total: open + accept + dismiss + defer, settled: accept + dismiss + defer };
    })
    .filter(({ total }) => total > 0);
  const total = rows.reduce((sum, row) => sum + row.total, 0);
  const settled = rows.reduce((sum, row) => sum + row.settled, 0);
  const label = say("page.progress", { settled: number(settled), total: number(total) });
  fill(
    place,
    h("progress", { max: Math.max(total, 1), value: settled, "aria-label": label }),
    h("span", { class: "numbers" }, label),
    h(
      "ul",
      { class: "by-verdict" },
      rows.map((row) => h("li", { title: say(`page.verdict.${row.verdict}`) }, mark(row.verdict), h("span", { class: "unseen" }, say(`page.verdict.${row.verdict}`)), number(row.total - row.settled))),
    ),
  );
}

export function showModes(place, session) {
  fill(
    place,
    session.read_only && h("span", { class: "mode read-only" }, say("page.mode.read-only")),
    session.blind && h("span", { class: "mode blind", title: say("page.mode.blind-hint") }, say("page.mode.blind")),
    session.reviewer && h("span", { class: "reviewer" }, session.reviewer),
  );
}
