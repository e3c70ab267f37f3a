/* The findings to go through, in the order of the filter, a page at a time; and those fetched ahead. */

import { get } from "./api.js";

const PAGE = 50;
const AHEAD = 3;
const KEPT = 40;

const SETTLED = new Set(["accept", "dismiss", "defer"]);

export const FILTERS = ["verdict", "state", "road", "drive", "kommune", "order"];

export class Queue {
  constructor() {
    this.filter = {};
    this.hasBegun = false;
    this.items = [];
    this.total = 0;
    this.byId = new Map();
    this.states = new Map();
    this.fetched = new Map();
  }

  /** Begin anew with a filter. */
  async begin(filter) {
    const page = await get("api/findings", { ...filter, offset: 0, limit: PAGE });
    this.filter = filter;
    this.hasBegun = true;
    this.items = [];
    this.byId = new Map();
    this.take(page);
  }

  take(page) {
    this.total = page.total;
    for (const item of page.items) {
      if (this.byId.has(item.change_id)) continue;
      this.byId.set(item.change_id, item);
      this.items.push(item);
    }
  }

  /** Fetch the next page; false where there is none. */
  async more() {
    const isOpenOnly = !this.filter.state || this.filter.state === "open";
    // Answered findings have left the server's list of open ones.
    const offset = isOpenOnly ? this.items.filter((item) => !this.isSettled(item.change_id)).length : this.items.length;
    const before = this.items.length;
    const total = this.total;
    this.take(await get("api/findings", { ...this.filter, offset, limit: PAGE }));
    // The server no longer counts what was answered here; answers on their way it still does.
    this.total = Math.max(this.items.length, Math.min(total, this.total + before - offset));
    return this.items.length > before;
  }

  stateOf(id) {
    return this.states.get(id) ?? this.byId.get(id)?.state ?? "open";
  }

  isSettled(id) {
    return SETTLED.has(this.stateOf(id));
  }

  /** What was answered here counts at once, whatever an older answer of the server says. */
  settle(id, state) {
    this.states.set(id, state);
    this.forget(id);
  }

  /** The server's word replaces ours. */
  forget(id) {
    this.fetched.delete(id);
  }

  indexOf(id) {
    return this.items.findIndex((item) => item.change_id === id);
  }

  /** How many of the filter's findings are left to decide. */
  get left() {
    const answered = this.items.filter((item) => !SETTLED.has(item.state) && this.isSettled(item.change_id)).length;
    return Math.max(0, this.total - answered);
  }

  /** The neighbour in the list, settled or not. */
  async beside(id, step) {
    const at = this.indexOf(id);
    if (step > 0 && at + step >= this.items.length) await this.more();
    return this.items[at < 0 ? 0 : at + step]?.change_id ?? null;
  }

  /** The next one to decide after `id`, then from the beginning; null where all are settled. */
  nextOpen(id) {
    const at = this.indexOf(id);
    const order = [...this.items.slice(at + 1), ...this.items.slice(0, Math.max(at, 0))];
    return order.find((item) => !this.isSettled(item.change_id))?.change_id ?? null;
  }

  /** The same; asks the server for more before it says that there are none. */
  async findNextOpen(id) {
    const next = this.nextOpen(id);
    const isLast = next === null || this.indexOf(next) < this.indexOf(id);
    if (!isLast) return next;
    return (await this.more()) ? this.nextOpen(id) : next;
  }

  /** One finding, from those fetched ahead where it is there. */
  finding(id) {
    let answer = this.fetched.get(id);
    if (!answer) {
      answer = get(`api/finding/${encodeURIComponent(id)}`);
      this.fetched.set(id, answer);
      answer.then(fetchPictures, () => this.fetched.delete(id));
      while (this.fetched.size > KEPT) this.fetched.delete(this.fetched.keys().next().value);
    }
    return answer;
  }

  /** Fetch the next few with their pictures, so that moving on shows them at once. */
  fetchAhead(id) {
    const at = this.indexOf(id);
    const coming = this.items.slice(at + 1).filter((item) => !this.isSettled(item.change_id));
    for (const item of coming.slice(0, AHEAD)) this.finding(item.change_id).catch(() => undefined);
    const loaded = this.items.length - at;
    if (loaded < PAGE / 2 && this.items.length < this.total) this.more().catch(() => undefined);
  }
}

function fetchPictures(finding) {
  for (const crop of finding.crops) new Image().src = crop.url;
  for (const side of [finding.claim, finding.seen]) {
    for (const { code } of side?.codes ?? []) new Image().src = signUrl(code, side.text);
  }
}

/** The drawing of a sign, with what is written on it. */
export function signUrl(code, text) {
  const url = `sign/${encodeURIComponent(code)}.svg`;
  return text ? `${url}?text=${encodeURIComponent(text)}` : url;
}
