/* Every finding on one map. The list says the same in words, for whoever cannot use a map. */

import { get } from "./api.js";
import { fill, h } from "./dom.js";
import { makeMap, noMap } from "./maps.js";
import { DRIVE_COLOUR, mark, MARKS } from "./marks.js";
import { say } from "./words.js";

const SHAPES_FROM = 13;
const shade = ["case", ["in", ["get", "state"], ["literal", ["open", "disagreement"]]], 1, 0.35];

// From far away thousands are dots, which cost least to draw; from near they have their shapes.
const LAYERS = [
  {
    id: "dots",
    type: "circle",
    maxzoom: SHAPES_FROM,
    layout: { "circle-sort-key": ["get", "rank"] },
    paint: {
      "circle-color": ["match", ["get", "verdict"], ...Object.entries(MARKS).flatMap(([verdict, { colour }]) => [verdict, colour]), "#8f93a0"],
      "circle-radius": ["interpolate", ["linear"], ["zoom"], 6, 2.5, SHAPES_FROM, 5],
      "circle-opacity": shade,
    },
  },
  {
    id: "shapes",
    type: "symbol",
    minzoom: SHAPES_FROM,
    layout: { "icon-image": ["concat", "verdict-", ["get", "verdict"]], "icon-allow-overlap": true, "icon-ignore-placement": true, "symbol-sort-key": ["get", "rank"] },
    paint: { "icon-opacity": shade },
  },
];

// Where nobody drove, no finding is a good sign of nothing.
const TRACK = { id: "track", type: "line", source: "tracks", layout: { "line-cap": "round", "line-join": "round" }, paint: { "line-color": DRIVE_COLOUR, "line-width": 2, "line-opacity": 0.4 } };

export class Overview {
  /** @param {{baseMap: object | null, bounds: number[], onopen: (id: string) => void}} options */
  constructor(place, options) {
    this.options = options;
    this.stage = h("div", { class: "map whole" });
    this.state = h("p", { class: "hint" });
    fill(place, this.stage, h("div", { class: "below" }, this.state, verdictLegend()));
    this.ready = this.begin();
  }

  async begin() {
    try {
      this.map = await makeMap(this.stage, { baseMap: this.options.baseMap, label: say("page.view.map"), onhome: () => this.home() });
    } catch (error) {
      console.warn(error);
      noMap(this.stage);
      return;
    }
    const tracks = await get("api/tracks").catch(() => ({ type: "FeatureCollection", features: [] }));
    this.map.addSource("tracks", { type: "geojson", data: tracks });
    this.map.addLayer(TRACK);
    this.map.addSource("findings", { type: "geojson", data: { type: "FeatureCollection", features: [] }, tolerance: 0, maxzoom: 16 });
    for (const layer of LAYERS) {
      this.map.addLayer({ ...layer, source: "findings" });
      this.map.on("click", layer.id, (event) => this.options.onopen(event.features[0].properties.id));
      this.map.on("mouseenter", layer.id, () => (this.map.getCanvas().style.cursor = "pointer"));
      this.map.on("mouseleave", layer.id, () => (this.map.getCanvas().style.cursor = ""));
    }
    // Until the person moves the map it shows all there is, in whatever room the filter leaves it.
    this.map.on("movestart", (event) => (this.isMoved ||= Boolean(event.originalEvent)));
    this.map.on("resize", () => this.isMoved || this.home());
  }

  home() {
    if (!this.bounds) return;
    this.isMoved = false;
    const [west, south, east, north] = this.bounds;
    this.map.fitBounds([west, south, east, north], { padding: 40, maxZoom: 17, animate: false });
  }

  /** Show what the filter lets through; `stateOf` knows answers that are younger than the server's list. */
  async show(filter, stateOf) {
    await this.ready;
    if (!this.map) return;
    const points = await get("api/points", filter);
    const features = [];
    const order = Object.keys(MARKS);
    for (let at = 0; at < points.change_id.length; at += 1) {
      const verdict = points.verdict[at];
      const state = stateOf(points.change_id[at]) ?? points.state[at];
      if (filter.state && filter.state !== "all" && filter.state !== state) continue;
      features.push({
        type: "Feature",
        properties: { id: points.change_id[at], verdict, state, rank: order.indexOf(verdict) },
        geometry: { type: "Point", coordinates: [points.lon[at], points.lat[at]] },
      });
    }
    this.map.getSource("findings").setData({ type: "FeatureCollection", features });
    this.map.resize();
    // Another filter, another place to look at.
    const asked = JSON.stringify(filter);
    if (this.asked !== asked) {
      this.asked = asked;
      this.bounds = boundsOf(features) ?? this.options.bounds;
      this.home();
    }
    this.state.textContent = say("page.overview", { count: features.length });
    this.map.once("idle", () => (this.stage.dataset.shown = String(features.length)));
  }
}

function boundsOf(features) {
  const places = features.map((one) => one.geometry.coordinates);
  if (!places.length) return null;
  const edge = (pick, axis) => places.reduce((found, place) => pick(found, place[axis]), places[0][axis]);
  return [edge(Math.min, 0), edge(Math.min, 1), edge(Math.max, 0), edge(Math.max, 1)];
}

const verdictLegend = () =>
  h("ul", { class: "legend" }, Object.keys(MARKS).reverse().map((verdict) => h("li", {}, mark(verdict), say(`page.verdict.${verdict}`))));
