/* The bar at the foot of a finding: a comment and the answers, or the name of who reviews, asked once. */

import { post } from "./api.js";
import { fill, h } from "./dom.js";
import { sayOf } from "./finding.js";
import { showModes } from "./notices.js";
import { say } from "./words.js";

const KINDS = [
  ["accept", "A"],
  ["dismiss", "D"],
  ["temporary", "T"],
  ["defer", "S"],
];

/** What stands only as long as road works last is nothing for NVDB: only a sign that NVDB lacks can be that. */
const isOffered = (kind, finding) => kind !== "temporary" || finding.verdict === "new";

export class Answers {
  constructor(place, page) {
    this.place = place;
    this.page = page;
    this.drafts = new Map();
  }

  show(finding) {
    this.finding = finding;
    this.pending = null;
    const { session } = this.page;
    this.place.hidden = false;
    if (session.read_only) fill(this.place, h("p", { class: "hint" }, say("page.answers.read-only")));
    else if (!session.reviewer) this.askName();
    else if (!finding.can_answer) fill(this.place, h("p", { class: "hint" }, finding.notice ?? say("page.answers.nothing")), this.undoButton());
    else this.showButtons(finding);
  }

  get canAnswer() {
    return Boolean(this.buttons) && this.finding?.can_answer && !this.page.session.read_only && Boolean(this.page.session.reviewer);
  }

  showButtons(finding) {
    this.comment = h("input", {
      id: "comment",
      type: "text",
      maxlength: 2000,
      autocomplete: "off",
      placeholder: say("page.answers.comment-hint"),
      oninput: () => this.drafts.set(finding.change_id, this.comment.value),
    });
    this.comment.value = this.drafts.get(finding.change_id) ?? "";
    this.buttons = Object.fromEntries(KINDS.filter(([kind]) => isOffered(kind, finding)).map(([kind, key]) => [kind, this.button(kind, key, finding)]));
    const focused = this.place.contains(document.activeElement) ? document.activeElement.dataset.kind : null;
    fill(
      this.place,
      h(
        "form",
        { class: "comment", onsubmit: (event) => this.submit(event) },
        h("label", { for: "comment" }, say("page.answers.comment")),
        this.comment,
      ),
      h("div", { class: "buttons" }, Object.values(this.buttons), this.undoButton()),
    );
    // Who works with Tab and Enter stays on the same answer.
    if (focused) this.buttons[focused]?.focus();
  }

  button(kind, key, finding) {
    return h(
      "button",
      { type: "button", class: `answer ${kind}`, "data-kind": kind, "aria-keyshortcuts": key.toLowerCase(), onclick: () => this.give(kind) },
      h("kbd", { "aria-hidden": "true" }, key),
      h("span", {}, h("strong", {}, sayOf(`yes-no.${kind}`, finding.verdict)), h("small", {}, sayOf(`does.${kind}`, finding.verdict))),
    );
  }

  undoButton() {
    return h(
      "button",
      { type: "button", class: "undo", "aria-keyshortcuts": "u", onclick: () => this.page.undo() },
      h("kbd", { "aria-hidden": "true" }, "U"),
      h("span", {}, say("page.answers.undo")),
    );
  }

  /** An answer at once. */
  give(kind) {
    if (!this.canAnswer) {
      this.place.querySelector("input")?.focus();
      return;
    }
    if (!this.buttons[kind]) return;
    const comment = this.comment.value.trim();
    this.drafts.delete(this.finding.change_id);
    this.page.answer(kind, comment);
  }

  /** An answer with a comment: Enter in the field gives it. */
  giveWithComment(kind) {
    if (!this.canAnswer || !this.buttons[kind]) return;
    this.pending = kind;
    for (const [one, button] of Object.entries(this.buttons)) button.classList.toggle("chosen", one === kind);
    this.comment.focus();
    this.page.tell(say("page.said.comment"));
  }

  submit(event) {
    event.preventDefault();
    if (this.pending) this.give(this.pending);
    else this.buttons.accept.focus();
  }

  /** Leave the field; a chosen answer is chosen no more. */
  leave() {
    this.pending = null;
    for (const button of Object.values(this.buttons ?? {})) button.classList.remove("chosen");
    document.activeElement?.blur();
  }

  askName() {
    this.buttons = null;
    const field = h("input", { id: "name", type: "text", maxlength: 80, required: true, autocomplete: "name" });
    field.value = localStorage.getItem("twin-review-name") ?? "";
    const refused = h("p", { class: "hint", role: "alert" });
    const known = this.page.session.reviewers ?? [];
    const begin = async (event) => {
      event.preventDefault();
      try {
        const { reviewer } = await post("api/reviewer", { name: field.value.trim() });
        localStorage.setItem("twin-review-name", reviewer);
        this.page.session.reviewer = reviewer;
        showModes(document.getElementById("modes"), this.page.session);
        this.show(this.finding);
        document.getElementById("question")?.focus();
      } catch (error) {
        refused.textContent = error.message;
      }
    };
    fill(
      this.place,
      h(
        "form",
        { class: "name", onsubmit: begin },
        h("label", { for: "name" }, say("page.name.ask")),
        field,
        h("button", { type: "submit", class: "primary" }, say("page.name.begin")),
        known.length > 0 && h("datalist", { id: "names" }, known.map((name) => h("option", { value: name }))),
        refused,
      ),
    );
    if (known.length) field.setAttribute("list", "names");
  }
}

