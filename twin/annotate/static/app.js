/* The annotation page: which picture and sign are chosen, and what the person does with them. */

import { Refused, get, post } from "./api.js";
import { Codes } from "./codes.js";
import { byId, fill, h } from "./dom.js";
import { layHelp, listenToKeys } from "./keys.js";
import { Pictures } from "./pictures.js";
import { Stage } from "./stage.js";
import { number, say, speak } from "./words.js";

/* The server's word for a code that its list does not have. */
const UNKNOWN_CODE = 422;
/* A click that misses by more is likely of another pole. */
const FAR_PX = 40;

const pictures = new Pictures();
let session = null;
let signs = [];
let camera = null;
let at = 0;
let sign = "";
let shown = 0;
let queue = Promise.resolve();

const stage = new Stage({
  foot: (point, of) => mark("foot", point, of),
  box: (edges, of) => mark("box", edges, of),
});
const codes = new Codes((text, isMeant) => name(text, isMeant));
const chosen = () => signs.find((one) => one.object === sign);
const frame = () => camera.frames[at];

// -- the picture ---------------------------------------------------------------------------------------------

async function show() {
  const turn = ++shown;
  layWhere();
  const asked = [camera.name, frame()];
  try {
    const [image, record] = await Promise.all([pictures.get(...asked), get(`api/picture/${encodeURIComponent(asked[0])}/${asked[1]}`)]);
    if (turn !== shown) return;
    stage.sign = sign;
    stage.show(image, record);
    document.body.dataset.frame = `${asked[0]}/${asked[1]}`;
    if (at + 1 < camera.frames.length) pictures.get(camera.name, camera.frames[at + 1]).catch(() => {});
  } catch (error) {
    if (turn !== shown) return;
    stage.show(null, { marks: [], proposals: [] });
    document.body.dataset.frame = `${asked[0]}/${asked[1]}`;
    tell(error.message || say("annotate.no.server"));
  }
}

function go(name, number_) {
  camera = session.cameras.find((one) => one.name === name) ?? camera;
  at = nearest(camera.frames, number_);
  return show();
}

const nearest = (values, wanted) => values.reduce((best, value, k) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? k : best), 0);

function step(by) {
  at = Math.min(Math.max(at + by, 0), camera.frames.length - 1);
  return show();
}

/** The next camera, at the picture that was taken at the same moment. */
function otherCamera() {
  const next = session.cameras[(session.cameras.indexOf(camera) + 1) % session.cameras.length];
  const moment = camera.moments_s[at];
  const known = moment >= 0 && next.moments_s.some((one) => one >= 0);
  at = known ? nearest(next.moments_s, moment) : nearest(next.frames, frame());
  camera = next;
  return show();
}

// -- what the person does ------------------------------------------------------------------------------------

/** One change after the other: each answer holds all signs. `refused(status)` hears of a change that was not made. */
function change(path, body, refused = () => undefined) {
  queue = queue.then(async () => {
    try {
      const state = await post(`api/${path}`, body);
      signs = state.signs;
      if (state.object && signs.some((one) => one.object === state.object)) sign = state.object;
      if (!signs.some((one) => one.object === sign)) sign = "";
      tell(state.copies.length ? say("annotate.copied", { files: state.copies.join(", ") }) : say("annotate.saved", { file: camera.file }));
      lay();
      await show();
      return true;
    } catch (error) {
      tell(error instanceof Refused ? error.message : say("annotate.no.server"));
      refused(error.status);
      return false;
    }
  });
  return queue;
}

async function mark(kind, place, of) {
  const isNew = !of;
  const done = await change("mark", { object: of, camera: camera.name, frame: frame(), kind, place_px: place });
  setMode("foot");
  if (!done) return;
  const one = chosen();
  if (one?.worst_px > FAR_PX) tell(say("annotate.far", { sign: one.object, px: number(one.worst_px) }));
  // The field is not entered: the keys go on working, and a digit begins the code.
  if (isNew) tell(say("annotate.name.it", { sign }));
}

async function confirm() {
  const proposed = stage.record.proposals;
  const one = proposed.find((item) => item.object === sign) ?? proposed[0];
  if (!one) {
    tell(say("annotate.nothing"));
    return;
  }
  const here = { object: one.object, camera: camera.name, frame: frame() };
  if (!(await change("confirm", here))) return;
  tell(say("annotate.seen", { sign: one.object }));
  const mine = chosen();
  const left = (mine.in_view[camera.name] ?? []).filter((other) => !(mine.marked[camera.name] ?? []).includes(other));
  if (left.length) await go(camera.name, left.find((other) => other > here.frame) ?? left[0]);
}

function name(text, isMeant) {
  if (sign) change("name", { object: sign, codes: text, is_meant: isMeant }, (status) => status === UNKNOWN_CODE && codes.doubt(text));
}

function offer() {
  const first = chosen()?.offers[0];
  if (first) return go(first.camera, first.frame);
  return tell(say("annotate.offers.none"));
}

function code() {
  byId("code").focus();
  byId("code").select();
}

function setMode(mode) {
  stage.mode = mode;
  for (const one of ["foot", "box"]) document.querySelector(`[data-act="${one}"]`).setAttribute("aria-pressed", String(mode === one));
}

function choose(object) {
  sign = object;
  lay();
  stage.sign = sign;
  stage.draw();
}

function nextSign() {
  if (!signs.length) return;
  const one = signs[(signs.findIndex((other) => other.object === sign) + 1) % signs.length];
  choose(one.object);
  visit(one);
}

/** Look at a sign: where it is offered, else where it is marked. */
function visit(one) {
  const [of, frames] = Object.entries(one.marked)[0];
  const known = session.cameras.some((other) => other.name === of);
  if (known) go(of, frames.at(-1));
}

const acts = {
  step,
  confirm,
  offer,
  code,
  foot: () => setMode("foot"),
  box: () => setMode("box"),
  new: () => (choose(""), setMode("foot")),
  camera: otherCamera,
  sign: nextSign,
  remove: () => sign && change("remove", { object: sign, camera: camera.name, frame: frame() }),
  undo: () => change("undo", {}),
  help: () => {
    byId("help").hidden = !byId("help").hidden;
    byId("open-help").setAttribute("aria-expanded", String(!byId("help").hidden));
  },
  escape: () => {
    document.activeElement?.blur();
    setMode("foot");
    if (!byId("help").hidden) acts.help();
  },
};

// -- what is shown beside the picture ------------------------------------------------------------------------

function tell(sentence) {
  byId("said").textContent = sentence;
}

function layWhere() {
  const moment = camera.moments_s[at];
  const when = moment >= 0 ? ` · ${say("annotate.moment", { seconds: number(moment, 1) })}` : "";
  byId("where").textContent = say("annotate.picture", { camera: camera.name, at: at + 1, n: camera.frames.length, frame: frame() }) + when;
  for (const button of byId("cameras").children) button.setAttribute("aria-pressed", String(button.textContent === camera.name));
  layLine();
}

/** All pictures of the camera in a line: where the sign is in view, marked, and worth a click. */
function layLine() {
  const one = chosen();
  const last = camera.frames.at(-1) || 1;
  const tick = (kind) => (number_) => {
    const element = h("i", { class: kind });
    element.style.left = `${(100 * number_) / last}%`;
    return element;
  };
  fill(
    byId("line"),
    (one?.in_view[camera.name] ?? []).map(tick("view")),
    (one?.marked[camera.name] ?? []).map(tick("mark")),
    (one?.offers ?? []).filter((other) => other.camera === camera.name).map((other) => tick("offer")(other.frame)),
    tick("here")(frame()),
  );
}

function lay() {
  fill(byId("signs"), signs.length ? signs.map(row) : h("li", { class: "hint" }, say("annotate.none")));
  const one = chosen();
  if (document.activeElement !== byId("code")) byId("code").value = one?.codes ?? "";
  byId("code").disabled = !one || one.is_foreign;
  const offered = (one?.offers ?? []).map((other) => say("annotate.offers.one", { camera: other.camera, metres: number(other.range_m) }));
  byId("offers").textContent = !one || one.is_foreign ? "" : offered.length ? say("annotate.offers.list", { list: offered.join(", ") }) : say("annotate.offers.none");
  layLine();
}

function row(one) {
  const facts = [say("annotate.clicks", { clicks: one.n_clicks, seen: one.n_seen })];
  if (one.sigma_m !== null) facts.push(say("annotate.sigma", { cm: number(one.sigma_m * 100) }));
  if (one.worst_px !== null && one.n_clicks > 1) facts.push(say("annotate.worst", { px: number(one.worst_px) }));
  if (one.is_foreign) facts.push(say("annotate.foreign", { file: say("annotate.other") }));
  const first = one.codes.split(";")[0];
  return h(
    "li",
    {},
    h(
      "button",
      { type: "button", "aria-pressed": String(one.object === sign), onclick: () => (choose(one.object), visit(one)) },
      first && h("img", { src: `sign/${encodeURIComponent(first)}.svg`, alt: "" }),
      h("span", {}, `${one.object} · ${one.title || say("annotate.code.none")}`, h("small", {}, facts.join(" · "))),
    ),
  );
}

async function open() {
  session = await get("api/session");
  const { messages, lang, state } = session;
  speak(messages, lang);
  signs = state.signs;
  byId("drive").textContent = session.drive;
  fill(byId("notices"), session.notices.map((text) => h("p", { class: "notice", role: "status" }, text)));
  fill(byId("cameras"), session.cameras.map((one) => h("button", { type: "button", onclick: () => (camera === one ? null : otherCameraTo(one)) }, one.name)));
  layHelp();
  for (const button of document.querySelectorAll("[data-act]")) button.addEventListener("click", () => acts[button.dataset.act]());
  byId("open-help").addEventListener("click", acts.help);
  byId("line").addEventListener("click", (event) => {
    const box = byId("line").getBoundingClientRect();
    go(camera.name, ((event.clientX - box.left) / box.width) * camera.frames.at(-1));
  });
  listenToKeys(acts);
  setMode("foot");
  camera = session.cameras[0];
  lay();
  tell(say("annotate.begin"));
  await show();
  document.body.dataset.ready = "true";
}

async function otherCameraTo(one) {
  while (camera !== one) await otherCamera();
}

open().catch((error) => tell(error.message || "The server does not answer. / Tjeneren svarer ikke."));
