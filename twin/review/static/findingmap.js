/* The map of one finding: where it was seen with its ellipse and rays, where the cameras stood and looked, NVDB's place. */

import { h } from "./dom.js";
import { isDark, makeMap, maplibre, noMap } from "./maps.js";
import { DRIVE_COLOUR, NVDB_COLOUR, SEEN_COLOUR } from "./marks.js";
import { number, say } from "./words.js";

const EMPTY = { type: "FeatureCollection", features: [] };
const SHOWN_M = 45;
const kind = (...kinds) => ["in", ["get", "kind"], ["literal", kinds]];

const icon = (id, image, filter, layout = {}) => ({
  id,
  type: "symbol",
  source: "finding",
  filter,
  layout: { "icon-image": image, "icon-allow-overlap": true, "icon-ignore-placement": true, ...layout },
});

const LAYERS = [
  { id: "track", type: "line", source: "finding", filter: kind("track"), layout: { "line-cap": "round", "line-join": "round" }, paint: { "line-color": DRIVE_COLOUR, "line-width": 3, "line-opacity": 0.55 } },
  { id: "ray", type: "line", source: "finding", filter: kind("ray"), paint: { "line-color": isDark() ? "#56b4e9" : "#0072b2", "line-width": 1, "line-opacity": 0.35 } },
  { id: "ellipse", type: "fill", source: "finding", filter: kind("ellipse"), paint: { "fill-color": "#e69f00", "fill-opacity": 0.35 } },
  { id: "ellipse-edge", type: "line", source: "finding", filter: kind("ellipse"), paint: { "line-color": "#b26a00", "line-width": 1.5 } },
  { id: "shift", type: "line", source: "shift", paint: { "line-color": NVDB_COLOUR, "line-width": 2, "line-dasharray": [2, 1.5] } },
  { id: "neighbour", type: "circle", source: "finding", filter: kind("neighbour"), paint: { "circle-radius": 5, "circle-color": "#ffffff", "circle-stroke-color": "#6b7682", "circle-stroke-width": 2 } },
  icon("camera", "camera", kind("camera"), { "icon-size": 0.75, "icon-rotate": ["coalesce", ["get", "facing_deg"], 0], "icon-rotation-alignment": "map" }),
  icon("nvdb", "nvdb", kind("nvdb")),
  icon("seen", "seen", kind("seen")),
];

export class FindingMap {
  /** @param {{baseMap: object | null}} session */
  constructor(place, { baseMap }) {
    this.place = place;
    this.labels = [];
    this.ready = this.begin(baseMap);
  }

  async begin(baseMap) {
    try {
      this.map = await makeMap(this.place, { baseMap, label: say("page.map.title"), onhome: () => this.home(!this.isClose) });
    } catch (error) {
      console.warn(error);
      noMap(this.place);
      return;
    }
    this.place.append(legend());
    // Centimetres count here: tiles are cut deeper than a road map's.
    this.map.addSource("finding", { type: "geojson", data: EMPTY, maxzoom: 22, tolerance: 0.1 });
    this.map.addSource("shift", { type: "geojson", data: EMPTY, maxzoom: 22 });
    for (const layer of LAYERS) this.map.addLayer(layer);
  }

  async show(finding) {
    this.finding = finding;
    await this.ready;
    if (!this.map || this.finding !== finding) return;
    const { features } = finding.map;
    this.map.getSource("finding").setData(finding.map);
    this.map.getSource("shift").setData(shiftOf(features));
    this.home();
    await this.label(features, finding);
    this.place.dataset.shown = finding.change_id;
  }

  /** The view that holds the sign, NVDB's place and the cameras nearby; or, close, the ellipse alone. */
  home(isClose = false) {
    if (!this.finding) return;
    const { features } = this.finding.map;
    const targets = pointsOf(features, ["seen", "nvdb"]);
    const middle = targets[0] ?? pointsOf(features, ["neighbour", "camera"])[0];
    if (!middle) return;
    const near = isClose ? [] : pointsOf(features, ["camera"]).filter((point) => metres(point, middle) < SHOWN_M);
    const bounds = boxOf([...targets, ...near, ...ellipseOf(features), middle]);
    this.isClose = isClose;
    this.map.resize();
    this.map.fitBounds(bounds, { padding: { top: 40, bottom: 44, left: 60, right: 120 }, maxZoom: isClose ? 23 : 21, animate: false });
  }

  async label(features, finding) {
    const { Marker } = await maplibre();
    this.labels.forEach((label) => label.remove());
    const put = (text, point, className, anchor, offset) =>
      new Marker({ element: h("span", { class: `label ${className}` }, text), anchor, offset }).setLngLat(point).addTo(this.map);
    const seen = pointsOf(features, ["seen"])[0];
    const nvdb = pointsOf(features, ["nvdb"])[0];
    // The two names never lie over one another: they hang on opposite sides.
    const isSeenEast = seen && nvdb ? seen[0] >= nvdb[0] : true;
    const side = (isEast) => (isEast ? ["left", [12, 0]] : ["right", [-12, 0]]);
    this.labels = [
      seen && put(say("page.map.seen"), seen, "seen", ...side(isSeenEast)),
      nvdb && put(nvdbLabel(finding), nvdb, "nvdb", ...side(!isSeenEast)),
      ...features
        .filter((feature) => feature.properties.kind === "neighbour" && feature.properties.title)
        .map((feature) => put(feature.properties.title, feature.geometry.coordinates, "neighbour", "left", [9, 0])),
    ].filter(Boolean);
  }
}

function nvdbLabel({ distance_m: distance, seen }) {
  const isAway = seen && distance !== null && distance >= 0.5;
  return isAway ? say("page.map.nvdb-away", { distance: number(distance, 1) }) : say("page.map.nvdb");
}

function legend() {
  const entries = ["seen", "nvdb", "ellipse", "ray", "camera", "track", "neighbour"];
  return h("ul", { class: "legend" }, entries.map((entry) => h("li", {}, h("span", { class: `key ${entry}`, "aria-hidden": "true" }), say(`page.legend.${entry}`))));
}

function shiftOf(features) {
  const ends = [...pointsOf(features, ["nvdb"]).slice(0, 1), ...pointsOf(features, ["seen"]).slice(0, 1)];
  return ends.length < 2 ? EMPTY : { type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: ends } };
}

const ellipseOf = (features) => features.filter((feature) => feature.properties.kind === "ellipse").flatMap((feature) => feature.geometry.coordinates[0]);

const pointsOf = (features, kinds) =>
  features.filter((feature) => kinds.includes(feature.properties.kind) && feature.geometry.type === "Point").map((feature) => feature.geometry.coordinates);

/** Near enough to choose what a first view holds. */
function metres([lon, lat], [lon0, lat0]) {
  const metresADegree = 111320;
  return Math.hypot((lon - lon0) * metresADegree * Math.cos((lat0 * Math.PI) / 180), (lat - lat0) * metresADegree);
}

function boxOf(points) {
  const lons = points.map(([lon]) => lon);
  const lats = points.map(([, lat]) => lat);
  return [
    [Math.min(...lons), Math.min(...lats)],
    [Math.max(...lons), Math.max(...lats)],
  ];
}
