/* The page: who reviews, which finding is shown, what was answered. */

import { Answers } from "./answers.js";
import { get, Refused } from "./api.js";
import { byId, fill, h } from "./dom.js";
import { layFinding, nameOf, questionOf, showFinding } from "./finding.js";
import { FindingMap } from "./findingmap.js";
import { layHelp, listenToKeys } from "./keys.js";
import { List } from "./list.js";
import { Notices, showModes, showProgress } from "./notices.js";
import { Outbox } from "./outbox.js";
import { Overview } from "./overview.js";
import { layFilter, Panels, showHistory } from "./panels.js";
import { FILTERS, Queue } from "./queue.js";
import { say, speak } from "./words.js";

class Page {
  constructor(session, queue) {
    this.session = session;
    this.queue = queue;
    this.notices = new Notices(byId("notices"));
    this.outbox = new Outbox(`twin-review-answers:${session.store}`, {
      reviewer: () => this.session.reviewer,
      reachable: () => this.onReachable(),
      lost: (pending, error) => this.notices.lost(pending, error),
      refused: (entry, error) => this.onRefused(entry, error),
    });
    // What an earlier page could not send counts as answered.
    for (const { body } of this.outbox.pending) if (body.change_id) queue.states.set(body.change_id, body.answer);
    this.hasOld = this.outbox.pending.length > 0;
    this.panels = new Panels({ history: () => showHistory(byId("history"), this), help: () => undefined, filter: () => undefined });
    this.answers = new Answers(byId("answers"), this);
  }

  async begin() {
    layFinding(byId("finding"), { onbrowse: (step) => this.browse(step) });
    layFilter(byId("filter"), this.session, (filter) => this.setFilter(filter));
    layHelp(byId("help"));
    showModes(byId("modes"), this.session);
    if (this.session.notice && !this.session.read_only) this.notices.standing(this.session.notice);
    showProgress(byId("progress"), this.session.counts);
    for (const view of ["finding", "list", "map"]) byId(`view-${view}`).addEventListener("click", () => this.toggle(view));
    document.querySelector(".skip").addEventListener("click", (event) => {
      event.preventDefault();
      byId("question")?.focus();
    });
    window.addEventListener("popstate", () => this.follow());
    listenToKeys(this);
    await this.follow();
    if (this.outbox.pending.length) this.outbox.send();
  }

  // Where we are stands in the address after "#", so that reloading and going back work.

  get place() {
    return placeIn(location.hash);
  }

  addressOf(place) {
    const set = Object.entries(place).filter(([, value]) => value);
    return `#${new URLSearchParams(set)}`;
  }

  get filter() {
    return filterIn(this.place);
  }

  go(place, { replace = false } = {}) {
    const address = this.addressOf({ ...this.filter, ...place });
    if (replace) history.replaceState(null, "", address);
    else history.pushState(null, "", address);
    return this.follow();
  }

  setFilter(filter) {
    const { view } = this.place;
    history.pushState(null, "", this.addressOf({ ...filter, view }));
    return this.follow();
  }

  toggle(view) {
    return this.go({ view: view === "finding" || this.place.view === view ? "" : view, id: this.place.id ?? this.current });
  }

  /** Show what the address says. */
  async follow() {
    const place = this.place;
    const filter = this.filter;
    const view = place.view || "finding";
    try {
      if (JSON.stringify(filter) !== JSON.stringify(this.queue.filter) || !this.queue.hasBegun) {
        await this.queue.begin(filter);
      }
      byId("filter").show(filter);
      this.showView(view);
      if (view === "list") this.showList(place.id);
      else if (view === "map") await this.showOverview();
      else await this.showOne(place.id);
    } catch (error) {
      this.onFailure(error);
    }
  }

  showView(view) {
    byId("finding").hidden = view !== "finding";
    byId("answers").hidden = view !== "finding";
    byId("list").hidden = view !== "list";
    byId("overview").hidden = view !== "map";
    document.body.dataset.view = view;
    for (const name of ["finding", "list", "map"]) byId(`view-${name}`).setAttribute("aria-pressed", String(name === view));
  }

  showList(current) {
    this.list ??= new List(byId("list"), this.queue, { hrefOf: (id) => this.addressOf({ ...this.filter, id }) });
    this.list.show(current);
  }

  async showOverview() {
    const { base_map: baseMap, bounds } = this.session;
    this.overview ??= new Overview(byId("overview"), { baseMap, bounds, onopen: (id) => this.go({ view: "", id }) });
    await this.overview.show(this.filter, (id) => this.queue.states.get(id));
  }

  async showOne(id) {
    const shown = id ?? this.queue.nextOpen(null) ?? this.queue.items[0]?.change_id;
    if (!shown) {
      this.showEnd();
      return;
    }
    this.wanted = shown;
    const finding = await this.queue.finding(shown);
    if (this.wanted !== shown) return;
    if (!byId("question")) layFinding(byId("finding"), { onbrowse: (step) => this.browse(step) });
    this.current = shown;
    this.finding = finding;
    const state = this.queue.states.get(shown);
    showFinding(byId("finding"), state ? { ...finding, state } : finding, { index: this.queue.indexOf(shown), left: this.queue.left });
    this.answers.show(finding);
    document.title = `${questionOf(finding)} – ${say("page.title")}`;
    this.showMap(finding);
    this.queue.fetchAhead(shown);
  }

  showMap(finding) {
    const place = byId("map");
    if (this.map?.place !== place) this.map = new FindingMap(place, { baseMap: this.session.base_map });
    this.map.show(finding).catch((error) => console.warn(error));
  }

  showEnd() {
    this.current = this.finding = null;
    byId("answers").hidden = true;
    const isFiltered = FILTERS.some((name) => name !== "order" && this.filter[name]);
    const { blind } = this.session;
    const put = Object.values(this.session.counts).reduce((sum, states) => sum + (states.defer ?? 0), 0);
    fill(
      byId("finding"),
      h(
        "div",
        { class: "end" },
        h("h1", { tabindex: "-1" }, say(isFiltered ? "page.end.filtered" : blind ? "page.end.blind" : "page.end.all")),
        h("p", {}, say(blind ? "page.end.blind-next" : "page.end.next")),
        h(
          "p",
          { class: "row" },
          put > 0 && h("button", { type: "button", onclick: () => this.setFilter({ state: "defer" }) }, say("page.end.put-off", { count: put })),
          isFiltered && h("button", { type: "button", onclick: () => this.setFilter({}) }, say("page.end.without-filter")),
          h("button", { type: "button", onclick: () => this.go({ view: "list", id: "" }) }, say("page.view.list")),
        ),
      ),
    );
  }

  // Moving on and back.

  async browse(step) {
    try {
      const beside = await this.queue.beside(this.current, step);
      if (beside) await this.go({ id: beside });
      else this.tell(say(step > 0 ? "page.said.last" : "page.said.first"));
    } catch (error) {
      this.onFailure(error);
    }
  }

  /** Give an answer and move on at once; the box sends it. */
  async answer(given, comment) {
    const { finding } = this;
    if (!finding) return;
    const temporary = given === "temporary";
    const kind = temporary ? "dismiss" : given;
    const facts = { title: questionOf(finding), verdict: finding.verdict, answer: kind, comment };
    const before = this.queue.stateOf(finding.change_id);
    this.queue.settle(finding.change_id, kind);
    this.count(finding.verdict, before, kind);
    const body = { change_id: finding.change_id, answer: kind, comment, seen_revision: finding.revision, temporary };
    const sent = this.outbox.put("api/answer", body, facts);
    if (temporary) sent.then(() => this.refresh()).catch((error) => this.onFailure(error));
    const next = this.queue.nextOpen(finding.change_id);
    this.tell(say(`page.said.${kind}`, { title: nameOf(finding) }));
    try {
      await this.moveOn(finding.change_id, next);
    } catch (error) {
      this.onFailure(error);
    }
  }

  async moveOn(from, next) {
    const isWrapped = next !== null && this.queue.indexOf(next) < this.queue.indexOf(from);
    const target = next !== null && !isWrapped ? next : await this.queue.findNextOpen(from);
    if (target) await this.go({ id: target });
    else {
      history.pushState(null, "", this.addressOf(this.filter));
      this.showEnd();
    }
  }

  /** Signs of the same road works are settled with the one that was answered: read what is left anew. */
  async refresh() {
    const { counts } = await get("api/session");
    this.session.counts = counts;
    showProgress(byId("progress"), counts);
    await this.queue.begin(this.queue.filter);
    if (this.finding && this.queue.items.length && this.queue.indexOf(this.finding.change_id) < 0) await this.go({ id: this.queue.nextOpen(null) ?? "" });
  }

  /** Take the last answer back and show its question again. */
  async undo() {
    const answer = await this.outbox.put("api/undo", {}, { isUndo: true });
    if (!answer) return;
    const state = this.queue.stateOf(answer.change_id);
    this.queue.settle(answer.change_id, "open");
    const finding = await this.queue.finding(answer.change_id).catch(() => null);
    if (finding) this.count(finding.verdict, state, "open");
    this.tell(say("page.said.undo"));
    await this.go({ view: "", id: answer.change_id });
  }

  count(verdict, before, after) {
    const states = this.session.counts[verdict];
    if (!states || before === after) return;
    states[before] = Math.max(0, (states[before] ?? 0) - 1);
    states[after] = (states[after] ?? 0) + 1;
    showProgress(byId("progress"), this.session.counts);
  }

  // What goes wrong is said, and nothing is lost.

  onReachable() {
    this.notices.reachable();
    if (!this.hasOld) return;
    // This page did not count what an earlier one left.
    this.hasOld = false;
    this.refresh().catch((error) => this.onFailure(error));
  }

  onRefused(entry, error) {
    const id = entry.body.change_id;
    if (id) {
      this.queue.states.delete(id);
      this.queue.forget(id);
      this.count(entry.facts.verdict, entry.facts.answer, "open");
    }
    if (entry.body.comment) this.answers.drafts.set(id, entry.body.comment);
    const open = id && (() => this.go({ view: "", id }));
    this.notices.refused(entry.facts.title ?? "", error.message, open);
  }

  onFailure(error) {
    if (error instanceof Refused && error.status !== 403) this.notices.refused("", error.message, null);
    else this.notices.lost(this.outbox.pending.length, error, () => this.follow());
  }

  tell(sentence) {
    byId("said").textContent = sentence;
  }
}

const placeIn = (hash) => Object.fromEntries(new URLSearchParams(hash.slice(1)));
const filterIn = (place) => Object.fromEntries(FILTERS.filter((name) => place[name]).map((name) => [name, place[name]]));

async function start() {
  try {
    // Asked at once: neither needs the other.
    const queue = new Queue();
    const [session] = await Promise.all([get("api/session"), queue.begin(filterIn(placeIn(location.hash)))]);
    speak(session.messages, session.lang);
    const page = new Page(session, queue);
    window.twinReview = page;
    await page.begin();
    document.body.dataset.ready = "true";
  } catch (error) {
    // Before the session there are no messages: the server's own sentence, or the browser's.
    byId("notices").replaceChildren(h("p", { class: "notice", role: "alert" }, error.message));
    throw error;
  }
}

start();
