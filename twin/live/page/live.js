/* A drive that goes on: what the server says line by line, on a map and in words. */

import { get } from "./api.js";
import { byId, fill, h } from "./dom.js";
import { codeOf, DriveMap } from "./drivemap.js";
import { mark } from "./marks.js";
import { apart } from "./shapes.js";
import { has, number, percent, say, speak } from "./words.js";

const MOST_OBJECTS = 400;
const MOST_SAID = 9;
const AGAIN_MS = 2000;

class Live {
  constructor(session) {
    this.session = session;
    this.estimates = new Map();
    this.verdicts = new Map();
    this.said = [];
    this.map = new DriveMap(byId("map"), session, () => this.draw());
  }

  /** Listen for ever: a server that is started again is found again. */
  listen() {
    const socket = new WebSocket(new URL("live", location.href).href.replace(/^http/, "ws"));
    socket.onmessage = ({ data }) => this.take(JSON.parse(data));
    socket.onclose = () => {
      fill(byId("state"), h("strong", {}, say("live.ended")));
      setTimeout(() => this.listen(), AGAIN_MS);
    };
  }

  take(line) {
    const { properties } = line;
    if (line.id === "car") {
      this.map.drive(line);
      fill(byId("state"), ...stateOf(properties));
    } else if (properties.verdict) {
      keep(this.verdicts, line);
      this.tell(line);
    } else if (properties.state) {
      keep(this.estimates, line);
      this.refine(line);
    }
    this.draw();
  }

  /** Draw the map, once for however many lines come at once. */
  draw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = null;
      this.map.draw(this.estimates, this.verdicts);
    });
  }

  /** Put what is said of a sign first in the list. */
  tell(line) {
    const { verdict } = line.properties;
    this.said = this.said.filter(({ id }) => id !== line.id);
    if (verdict !== "expected" && verdict !== "withdrawn") this.said.unshift(line);
    this.said.length = Math.min(this.said.length, MOST_SAID);
    fill(byId("said"), this.said.map((one) => entry(one, this.session.names, this.estimates.get(one.properties.pole))));
  }

  /** A verdict is said anew where it changes; of how its place is known better since, the list tells too. */
  refine(estimate) {
    this.said.forEach((one, at) => {
      if (one.properties.pole === estimate.id) byId("said").children[at].querySelector("p span").textContent = factsOf(one, estimate);
    });
  }
}

/** The newest of an id, as the last of all; the oldest of too many are forgotten. */
function keep(lines, line) {
  lines.delete(line.id);
  lines.set(line.id, line);
  if (lines.size > MOST_OBJECTS) lines.delete(lines.keys().next().value);
}

/** What is known of a sign, by the newest estimate of its pole where it may still change. */
function factsOf({ properties }, estimate) {
  const { verdict, confidence, nvdb, final } = properties;
  const isNewer = !final && estimate?.geometry;
  const { major95_m } = isNewer ? estimate.properties : properties;
  const facts = [say(`page.verdict.${verdict}`)];
  if (properties.distance_m !== null) {
    const distance = isNewer ? apart(estimate.geometry.coordinates, nvdb) : properties.distance_m;
    facts.push(say("live.distance", { distance: number(distance, 1) }));
  }
  if (major95_m !== undefined) facts.push(`± ${number(major95_m, 1)} m`);
  if (confidence !== null && verdict !== "unchanged") facts.push(percent(confidence));
  return facts.join(" · ");
}

function entry(line, names, estimate) {
  const { verdict } = line.properties;
  const code = codeOf(line);
  return h(
    "li",
    { "data-verdict": verdict },
    code ? h("img", { src: `sign/${encodeURIComponent(code)}.svg`, alt: "" }) : h("span"),
    h("strong", {}, [code, names[code]].filter(Boolean).join(" – ") || line.id),
    // Numbers that change twice a second are not read out.
    h("p", {}, mark(verdict), h("span", { "aria-live": "off" }, factsOf(line, estimate))),
  );
}

/** How the car does, in one line; what is not as it should be stands out. */
function stateOf({ gnss, position, cameras, speed_mps, major95_m, frames_dropped, queue }) {
  const word = (health) => (has(`live.health.${health}`) ? say(`live.health.${health}`) : health);
  const part = (label, health) => h(health === "fine" ? "span" : "strong", {}, `${label}: ${word(health)}`);
  const parts = [part("GNSS", gnss)];
  if (position !== "fixed") parts.push(h("strong", {}, say(`live.position.${position}`)));
  if (major95_m !== undefined) parts.push(h("span", {}, `± ${number(major95_m, 2)} m`));
  if (speed_mps != null) parts.push(h("span", {}, `${number(3.6 * speed_mps)} km/h`));
  for (const [name, health] of Object.entries(cameras)) parts.push(part(name, health));
  parts.push(h(frames_dropped ? "strong" : "span", {}, say("live.frames", { queue: number(queue), dropped: number(frames_dropped) })));
  return parts.flatMap((one, at) => (at ? [" · ", one] : [one]));
}

const session = await get("api/session");
speak(session.messages, session.lang);
const live = new Live(session);
await live.map.ready;
live.listen();
document.body.dataset.ready = "true";
// What a test or a picture asks for.
window.twinLive = live;
