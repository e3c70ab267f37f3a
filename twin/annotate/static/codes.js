/* The field in which a sign's code is typed, by number or by name. */

import { get } from "./api.js";
import { byId, fill, h } from "./dom.js";

export class Codes {
  /** `name(codes, isMeant)` is called with what was chosen, and whether it was chosen again after a doubt. */
  constructor(name) {
    this.name = name;
    this.field = byId("code");
    this.list = byId("codes");
    this.items = [];
    this.at = 0;
    this.asked = 0;
    this.doubted = null;
    this.field.addEventListener("input", () => this.search());
    this.field.addEventListener("keydown", (event) => this.key(event));
    this.field.addEventListener("blur", () => this.close());
  }

  /** Plates before the last `;` stay as they are: several are typed one by one. */
  parts() {
    const all = this.field.value.split(";");
    return { before: all.slice(0, -1).map((one) => one.trim()), typed: all.at(-1).trim() };
  }

  async search() {
    const asked = ++this.asked;
    const { typed } = this.parts();
    const { items } = typed ? await get("api/codes", { q: typed }) : { items: [] };
    if (asked !== this.asked) return;
    this.items = items;
    this.at = 0;
    this.lay();
  }

  lay() {
    this.list.hidden = !this.items.length;
    this.field.setAttribute("aria-expanded", String(!this.list.hidden));
    fill(
      this.list,
      this.items.map((one, k) =>
        h(
          "li",
          { id: `code-${k}`, role: "option", "aria-selected": String(k === this.at), onpointerdown: (event) => (event.preventDefault(), this.choose(one.code)) },
          h("img", { src: `sign/${encodeURIComponent(one.code)}.svg`, alt: "" }),
          one.title,
        ),
      ),
    );
    if (this.items.length) this.field.setAttribute("aria-activedescendant", `code-${this.at}`);
    else this.field.removeAttribute("aria-activedescendant");
  }

  key(event) {
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      const n = this.items.length || 1;
      this.at = (this.at + (event.key === "ArrowDown" ? 1 : n - 1)) % n;
      this.lay();
    } else if (event.key === "Enter") {
      event.preventDefault();
      event.stopPropagation();
      const { typed } = this.parts();
      const exact = this.items.find((one) => one.code === typed);
      this.choose(exact ? typed : (this.items[this.at]?.code ?? typed));
    }
  }

  choose(code) {
    const codes = [...this.parts().before, code].filter(Boolean).join(";");
    this.field.value = codes;
    this.field.blur();
    const isMeant = codes === this.doubted;
    this.doubted = null;
    this.name(codes, isMeant);
  }

  /** No list has these codes: here they are again, to be corrected or meant. */
  doubt(codes) {
    this.doubted = codes;
    this.field.value = codes;
    this.field.focus();
  }

  close() {
    this.asked += 1;
    this.items = [];
    this.lay();
  }
}
