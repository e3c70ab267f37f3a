/* The pictures of a finding: the sign's face and the wider view, up to three of each; 1 2 3 choose. */

import { fill, h } from "./dom.js";
import { number, say } from "./words.js";

/** How pictures stand side by side: views by number, each with the roles that it has. */
function viewsOf(crops) {
  const views = new Map();
  for (const crop of crops) views.set(crop.number, { ...views.get(crop.number), [crop.role]: crop });
  return [...views.entries()].sort(([a], [b]) => a - b).map(([, view]) => view);
}

export function showPictures(place, finding) {
  const views = viewsOf(finding.crops);
  if (!views.length) {
    fill(place, nothing(finding));
    place.choose = () => false;
    return;
  }
  const stage = h("div", { class: "stage" });
  const caption = h("p", { class: "caption", "aria-live": "off" });
  const buttons = views.map((view, at) => thumbnail(view, at, () => choose(at)));
  const choose = (at) => {
    const view = views[at];
    if (!view) return false;
    fill(stage, ["face", "wide"].filter((role) => view[role]).map((role) => picture(view[role], titleOf(role, finding))));
    // Both as high as one another, whatever their shapes.
    const shares = ["face", "wide"].filter((role) => view[role]).map((role) => Math.min(2.2, Math.max(0.6, view[role].width / view[role].height)));
    stage.style.gridTemplateColumns = shares.map((share) => `minmax(0, ${share}fr)`).join(" ");
    fill(caption, captionOf(view.wide ?? view.face));
    buttons.forEach((button, one) => button.setAttribute("aria-pressed", String(one === at)));
    return true;
  };
  choose(0);
  place.choose = choose;
  fill(place, stage, h("div", { class: "strip" }, buttons.length > 1 && h("div", { class: "thumbnails" }, buttons), caption), gapsOf(finding));
}

/** What a picture shows; of a sign that is gone, the place where it should be. */
function titleOf(role, { verdict, claim }) {
  if (verdict === "missing") return say(`page.picture.${role}-missing`);
  return say(role === "wide" && claim ? "page.picture.wide-nvdb" : `page.picture.${role}`);
}

function picture(crop, says) {
  return h(
    "figure",
    { class: `picture ${crop.role}` },
    h("img", { src: crop.url, alt: `${says}: ${crop.caption}`, width: crop.width, height: crop.height, decoding: "sync" }),
    h("figcaption", {}, says),
  );
}

function thumbnail(view, at, onclick) {
  const crop = view.face ?? view.wide;
  return h(
    "button",
    { type: "button", onclick, "aria-pressed": "false", "aria-label": say("page.picture.number", { number: at + 1, range: number(crop.range_m, 0) }) },
    h("kbd", {}, at + 1),
    h("img", { src: crop.url, alt: "", height: 40 }),
    h("span", {}, `${number(crop.range_m, 0)} m`),
  );
}

function captionOf(crop) {
  const proof = typeof crop.proof === "string" ? crop.proof : null;
  return [h("span", {}, crop.caption), proof && h("span", { class: "proof" }, proof)];
}

function gapsOf(finding) {
  return finding.gaps.length > 0 && h("ul", { class: "gaps" }, finding.gaps.map((gap) => h("li", {}, gap)));
}

function nothing(finding) {
  return h("div", { class: "no-pictures" }, h("p", {}, h("strong", {}, say("page.picture.none"))), gapsOf(finding));
}
