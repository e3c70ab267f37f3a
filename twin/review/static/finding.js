/* One finding a screen: the question, the pictures, NVDB's claim beside what was seen, the reason. */

import { fill, h } from "./dom.js";
import { mark } from "./marks.js";
import { showPictures } from "./pictures.js";
import { signUrl } from "./queue.js";
import { has, number, percent, say, time } from "./words.js";

/** The words of a verdict where it has its own, else those that all share. */
export const sayOf = (kind, verdict, facts) => say(`page.${kind}.${has(`page.${kind}.${verdict}`) ? verdict : "other"}`, facts);

/** "142 – Barn", whether the name has its code already or not. */
export const signName = ({ code, name }) => (!name || name.startsWith(code) ? name || code : `${code} – ${name}`);

const names = (side) => side?.codes.map(signName).join(", ") ?? "";

/** What a finding is about, in a few words. */
export const nameOf = (finding) => names(finding.seen) || names(finding.claim) || finding.verdict_title;

/** The question in words, so that yes and no mean something on a road. */
export function questionOf(finding) {
  return sayOf("question", finding.verdict, {
    distance: finding.distance_m === null ? "" : number(finding.distance_m, finding.distance_m < 10 ? 1 : 0),
    nvdb: names(finding.claim),
    seen: names(finding.seen),
  });
}

/** The skeleton once; `showFinding` fills it. */
export function layFinding(section, { onbrowse }) {
  fill(
    section,
    h(
      "header",
      { class: "head" },
      h("div", { class: "asks" }, h("h1", { id: "question", tabindex: "-1" }), h("p", { id: "about", class: "about" })),
      h(
        "div",
        { class: "browse" },
        h("button", { type: "button", onclick: () => onbrowse(-1), "aria-label": say("page.previous"), title: say("page.previous") }, "‹", h("kbd", {}, "K")),
        h("span", { id: "place-in-queue" }),
        h("button", { type: "button", onclick: () => onbrowse(1), "aria-label": say("page.next"), title: say("page.next") }, h("kbd", {}, "J"), "›"),
      ),
    ),
    h("div", { class: "evidence" }, h("section", { id: "pictures", class: "pictures", "aria-label": say("page.pictures") }), h("div", { id: "why", class: "why" })),
    h(
      "div",
      { class: "facts" },
      h("div", { id: "claims", class: "claims" }),
      h("section", { id: "map", class: "map", "aria-label": say("page.map.title") }),
    ),
  );
}

export function showFinding(section, finding, { index, left }) {
  section.dataset.changeId = finding.change_id;
  section.classList.toggle("without-pictures", finding.crops.length === 0);
  const find = (id) => section.querySelector(`#${id}`);
  find("question").textContent = questionOf(finding);
  fill(find("about"), aboutOf(finding));
  find("place-in-queue").textContent = say("page.place-in-queue", { index: index < 0 ? "–" : number(index + 1), left: number(left) });
  showPictures(find("pictures"), finding);
  fill(find("claims"), claimOf(finding), seenOf(finding));
  fill(find("why"), whyOf(finding));
}

function aboutOf(finding) {
  return [
    h("span", { class: "verdict" }, mark(finding.verdict), say(`page.verdict.${finding.verdict}`)),
    h("span", {}, finding.road),
    h("span", { class: "sure" }, say("page.sure", { confidence: percent(finding.confidence) })),
    finding.state !== "open" && h("span", { class: `state ${finding.state}` }, say(`page.state.${finding.state}`)),
  ];
}

function signs(side) {
  // What is written stands on the plate below the sign, where there is one.
  const below = side.codes.findIndex(({ code }) => code.startsWith("8"));
  const written = Math.max(below, 0);
  return side.codes.map((sign, at) =>
    h(
      "li",
      {},
      h("img", { class: "sign", src: signUrl(sign.code, at === written ? side.text : ""), alt: say("page.drawing", { sign: signName(sign) }), height: 64 }),
      h("span", { class: "name" }, signName(sign)),
    ),
  );
}

function card(kind, title, side, nothing, lines) {
  return h(
    "section",
    { class: `card ${kind}`, "aria-label": title },
    h("h2", {}, h("span", { class: `dot ${kind}`, "aria-hidden": "true" }), title),
    side?.codes.length ? h("ul", { class: "signs" }, signs(side)) : h("p", { class: "nothing" }, nothing),
    side?.text ? h("p", { class: "written" }, say("page.written", { text: side.text })) : null,
    lines.filter(Boolean).map((line) => h("p", { class: "line" }, line)),
  );
}

function claimOf({ claim }) {
  const lines = claim
    ? [
        claim.accuracy_cm === null ? say("page.accuracy.unknown") : say("page.accuracy.known", { cm: number(claim.accuracy_cm) }),
        claim.last_modified && say("page.modified", { when: time(claim.last_modified) }),
        claim.url_vegkart &&
          h("a", { href: claim.url_vegkart, target: "_blank", rel: "noreferrer noopener" }, say("page.object", { type: claim.nvdb_type, id: claim.nvdb_id })),
      ]
    : [];
  return card("nvdb", say("page.claim.title"), claim, claim ? say("page.claim.no-sign") : say("page.claim.none"), lines);
}

function seenOf({ seen, seen_sentence: sentence }) {
  return card("seen", say("page.seen.title"), seen, say("page.seen.none"), [sentence, seen?.sigma_sentence]);
}

function whyOf(finding) {
  return [
    h("p", { class: "reason" }, finding.reason),
    h(
      "div",
      { class: "folds" },
      finding.terms.length > 0 &&
        h(
          "details",
          {},
          h("summary", {}, say("page.terms")),
          h("table", {}, h("tbody", {}, finding.terms.map((term) => h("tr", {}, h("th", { scope: "row" }, term.label), h("td", {}, String(term.value)), h("td", {}, term.explanation))))),
        ),
      h(
        "details",
        {},
        h("summary", {}, say("page.past.title", { count: number(finding.history.length) })),
        finding.history.length
          ? h("ol", { class: "past" }, finding.history.map((entry) => h("li", {}, h("time", { datetime: entry.at }, time(entry.at)), " ", entry.sentence)))
          : h("p", {}, say("page.past.none")),
      ),
    ),
  ];
}
