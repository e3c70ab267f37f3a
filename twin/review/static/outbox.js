/* Answers on their way to the server. Each is written down in the browser with a key of its own before it is sent, and
   struck out only when the server has answered: a lost network or a stopped server loses none, and the key keeps a
   repeated one from counting twice. All tabs share the box; a lock lets one of them send at a time. */

import { get, post, Refused, Unreachable } from "./api.js";

const PAUSES_MS = [300, 700, 1500, 3000, 5000];

export class Outbox {
  /**
   * @param {string} name of the box in the browser's storage: one a store of findings
   * @param {{reviewer: () => string, reachable: (pending: number) => void, lost: (pending: number) => void, refused: (entry: object, error: Refused) => void}} tell
   */
  constructor(name, tell) {
    this.name = name;
    this.tell = tell;
    this.waiting = new Map();
    this.failures = 0;
    this.sittingHere = null;
    window.addEventListener("online", () => this.send());
  }

  get entries() {
    try {
      return JSON.parse(localStorage.getItem(this.name) ?? "[]");
    } catch {
      return [];
    }
  }

  set entries(entries) {
    localStorage.setItem(this.name, JSON.stringify(entries));
  }

  /** The findings whose answers are still here. */
  get pending() {
    return this.entries;
  }

  /** Keep one request and send it; resolves with the server's answer, or null if another tab sent it or it was refused. */
  put(path, body, facts = {}) {
    const entry = { key: newKey(), by: this.tell.reviewer(), path, body, facts };
    this.entries = [...this.entries, entry];
    const done = new Promise((resolve) => this.waiting.set(entry.key, resolve));
    this.send();
    return done;
  }

  /** Send what is in the box, in its order, until it is empty or nobody answers. */
  async send() {
    clearTimeout(this.timer);
    await exclusively(this.name, async () => {
      for (let entry = this.entries[0]; entry; entry = this.entries[0]) {
        let answer = null;
        try {
          await this.sit(entry.by);
          answer = await post(entry.path, entry.body, entry.key);
        } catch (error) {
          if (error instanceof Unreachable || isShut(error)) {
            this.retry(error);
            return;
          }
          if (!(error instanceof Refused)) throw error;
          this.strike(entry, null);
          this.tell.refused(entry, error);
          continue;
        }
        this.strike(entry, answer);
      }
      // What was kept may be somebody else's: the server goes on with who sits here now.
      const name = this.tell.reviewer();
      if (this.sittingHere !== null && name) {
        try {
          await this.sit(name);
        } catch (error) {
          if (!(error instanceof Refused)) this.sittingHere = null;
        }
      }
      // Empty, whoever sent it: the server is there.
      this.failures = 0;
      this.tell.reachable();
    });
    // Another tab may have sent ours meanwhile.
    const kept = new Set(this.entries.map((entry) => entry.key));
    for (const [key, resolve] of this.waiting) {
      if (!kept.has(key)) {
        this.waiting.delete(key);
        resolve(null);
      }
    }
  }

  /** Let the server know by whom the next answer is; one that was started anew knows nobody. */
  async sit(name) {
    if (this.sittingHere === name) return;
    const { reviewer } = await get("api/session");
    if (reviewer !== name) await post("api/reviewer", { name, of_kept_answers: true });
    this.sittingHere = name;
  }

  strike(entry, answer) {
    this.entries = this.entries.filter((one) => one.key !== entry.key);
    this.waiting.get(entry.key)?.(answer);
    this.waiting.delete(entry.key);
  }

  retry(error) {
    const pause = PAUSES_MS[Math.min(this.failures, PAUSES_MS.length - 1)];
    this.failures += 1;
    this.sittingHere = null;
    this.tell.lost(this.entries.length, error);
    this.timer = setTimeout(() => this.send(), pause);
  }
}

/** The server runs, but under another token than this page's: what is in the box waits for the new address. */
const isShut = (error) => error instanceof Refused && error.status === 403;

const newKey = () => crypto.randomUUID?.() ?? [...crypto.getRandomValues(new Uint32Array(4))].map((part) => part.toString(16)).join("-");

// Pages that are not served from this machine itself have no locks: the key still keeps an answer from counting twice.
const exclusively = (name, work) => (navigator.locks ? navigator.locks.request(name, work) : work());
