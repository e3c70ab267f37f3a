/* Every text of the page comes from the server's table of messages, in the language of the session. */

let table = {};
let locale = "en-GB";

/** Take the messages of a session, and write those that stand in the document by `data-say`. */
export function speak(messages, lang) {
  table = messages;
  locale = lang === "nb" ? "nb-NO" : "en-GB";
  document.documentElement.lang = lang;
  for (const element of document.querySelectorAll("[data-say]")) element.textContent = say(element.dataset.say);
  for (const element of document.querySelectorAll("[data-say-label]")) {
    element.setAttribute("aria-label", say(element.dataset.sayLabel));
    element.title = say(element.dataset.sayLabel);
  }
}

/** A message with its facts: `say("page.progress", {settled: 3, total: 9})`. */
export function say(key, facts = {}) {
  const text = table[key];
  if (text === undefined) return key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in facts ? String(facts[name]) : whole));
}

/** Whether a message exists: some verdicts have words of their own, the others share. */
export const has = (key) => key in table;

export const number = (value, digits = 0) =>
  new Intl.NumberFormat(locale, { maximumFractionDigits: digits, minimumFractionDigits: digits }).format(value);

/** A probability: near one with a decimal, and never quite one. */
export function percent(share) {
  const text = (value, digits) => new Intl.NumberFormat(locale, { style: "percent", maximumFractionDigits: digits }).format(value);
  return share > 0.9995 ? `> ${text(0.999, 1)}` : text(share, share > 0.99 ? 1 : 0);
}

export const time = (text) => {
  const at = new Date(text);
  return Number.isNaN(at.getTime())
    ? text
    : new Intl.DateTimeFormat(locale, { dateStyle: "medium", timeStyle: "short" }).format(at);
};
