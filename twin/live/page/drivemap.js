/* The map that moves with the car: track, cameras, objects with their ellipses, NVDB's signs ahead, verdicts. */

import { makeMap, noMap } from "./maps.js";
import { DRIVE_COLOUR, NVDB_COLOUR } from "./marks.js";
import { beside, collection, ellipse, feature, wedge } from "./shapes.js";
import { say } from "./words.js";

const REACH_M = 25;
// What comes matters more than what lies behind.
const AHEAD_M = 18;
const ZOOM = 17.6;
const LONGEST_TRACK = 3000;
const SOURCES = ["wedge", "track", "ellipse", "shift", "expected", "object", "verdict", "car"];
const icon = (id, image, layout = {}, source = id, filter = true) => ({
  id,
  type: "symbol",
  source,
  filter,
  layout: { "icon-image": image, "icon-allow-overlap": true, "icon-ignore-placement": true, ...layout },
});

const LAYERS = [
  { id: "wedge", type: "fill", source: "wedge", paint: { "fill-color": "#56b4e9", "fill-opacity": 0.14 } },
  { id: "track", type: "line", source: "track", layout: { "line-cap": "round", "line-join": "round" }, paint: { "line-color": DRIVE_COLOUR, "line-width": 4, "line-opacity": 0.5 } },
  { id: "ellipse", type: "fill", source: "ellipse", paint: { "fill-color": "#e69f00", "fill-opacity": 0.22 } },
  { id: "ellipse-edge", type: "line", source: "ellipse", paint: { "line-color": "#b26a00", "line-width": 1.5 } },
  { id: "shift", type: "line", source: "shift", paint: { "line-color": NVDB_COLOUR, "line-width": 2, "line-dasharray": [2, 1.5] } },
  { id: "expected", type: "circle", source: "expected", paint: { "circle-radius": 6, "circle-color": "#ffffff", "circle-stroke-color": NVDB_COLOUR, "circle-stroke-width": 2 } },
  icon("object", "seen", { "icon-size": 0.55 }),
  icon("verdict", ["concat", "verdict-", ["get", "verdict"]]),
  icon("face", ["concat", "sign-", ["get", "code"]], { "icon-offset": [0, -34], "icon-size": 0.8 }, "verdict", ["!=", ["get", "code"], ""]),
  icon("car", "camera", { "icon-rotate": ["get", "heading"], "icon-rotation-alignment": "map", "icon-size": 1.3 }),
];

export class DriveMap {
  /** @param {{base_map: object | null, cameras: object[]}} session; `onface` is called when there is more to draw. */
  constructor(place, session, onface) {
    this.place = place;
    this.onface = onface;
    this.cameras = session.cameras;
    this.track = [];
    this.isFollowing = true;
    this.faces = new Map();
    this.ready = this.begin(session.base_map);
  }

  async begin(baseMap) {
    try {
      this.map = await makeMap(this.place, { baseMap, label: say("live.map"), homeLabel: say("live.follow"), onhome: () => this.follow() });
    } catch (error) {
      console.warn(error);
      noMap(this.place);
      return;
    }
    for (const name of SOURCES) this.map.addSource(name, { type: "geojson", data: collection([]), maxzoom: 22, tolerance: 0.1 });
    for (const layer of LAYERS) this.map.addLayer(layer);
    this.map.setZoom(ZOOM);
    // Whoever looks elsewhere is left alone until the button is pressed.
    this.map.on("dragstart", () => (this.isFollowing = false));
  }

  follow() {
    this.isFollowing = true;
    if (!this.car) return;
    const turn = ((this.car.properties.heading_deg ?? 0) * Math.PI) / 180;
    this.map.jumpTo({ center: beside(this.car.geometry.coordinates, AHEAD_M * Math.sin(turn), AHEAD_M * Math.cos(turn)) });
  }

  /** Take where the car is. */
  drive(car) {
    if (!car.geometry) return;
    this.car = car;
    this.track.push(car.geometry.coordinates);
    if (this.track.length > LONGEST_TRACK) this.track = this.track.filter((_, at) => at % 2 === 0 || at > LONGEST_TRACK - 100);
  }

  /** Draw what is known now: estimates and verdicts by id. */
  draw(estimates, verdicts) {
    if (!this.map) return;
    const set = (name, features) => this.map.getSource(name).setData(collection(features));
    if (this.car) {
      const { coordinates } = this.car.geometry;
      const heading = this.car.properties.heading_deg ?? 0;
      const delivering = this.cameras.filter(({ name }) => name in this.car.properties.cameras);
      set("wedge", delivering.map((camera) => feature("Polygon", [wedge(coordinates, heading, camera, REACH_M)])));
      set("car", [feature("Point", coordinates, { heading })]);
      set("track", this.track.length > 1 ? [feature("LineString", this.track)] : []);
      if (this.isFollowing) this.follow();
    }
    const located = [...estimates.values()].filter((one) => one.geometry);
    set("ellipse", located.map(ellipseOf));
    const known = [...verdicts.values()];
    const standing = known.filter(({ properties }) => properties.verdict !== "expected" && properties.verdict !== "withdrawn");
    const poles = new Set(standing.map(({ properties }) => properties.pole));
    set("object", located.filter((one) => !poles.has(one.id)));
    set("expected", known.filter(({ properties }) => properties.verdict === "expected"));
    const placed = standing.map((one) => ({ ...one, geometry: estimates.get(one.properties.pole)?.geometry ?? one.geometry }));
    set("shift", placed.filter(({ properties }) => properties.verdict === "moved").map((one) => feature("LineString", [one.properties.nvdb, one.geometry.coordinates])));
    set("verdict", placed.map((one) => feature("Point", one.geometry.coordinates, { verdict: one.properties.verdict, code: this.face(codeOf(one)) })));
    this.place.dataset.shown = String(standing.length);
  }

  /** The code of a sign whose face the map has; it asks for one that it lacks, and says when it has come. */
  face(code) {
    if (!code || this.faces.has(code)) return this.faces.get(code) ?? "";
    this.faces.set(code, "");
    const picture = new Image(56, 56);
    picture.onload = () => {
      const canvas = document.createElement("canvas");
      canvas.width = canvas.height = 56;
      const scale = Math.min(56 / (picture.naturalWidth || 56), 56 / (picture.naturalHeight || 56));
      const [width, height] = [(picture.naturalWidth || 56) * scale, (picture.naturalHeight || 56) * scale];
      const brush = canvas.getContext("2d");
      brush.drawImage(picture, (56 - width) / 2, 56 - height, width, height);
      this.map.addImage(`sign-${code}`, brush.getImageData(0, 0, 56, 56), { pixelRatio: 2 });
      this.faces.set(code, code);
      this.onface();
    };
    picture.src = `sign/${encodeURIComponent(code)}.svg`;
    return "";
  }
}

/** The first code of a sign as it was seen, else as NVDB has it. */
export const codeOf = ({ properties }) => (properties.skiltnummer_seen || properties.skiltnummer_nvdb).split(";")[0];

const ellipseOf = ({ geometry, properties }) =>
  feature("Polygon", [ellipse(geometry.coordinates, properties.major95_m, properties.minor95_m, properties.sigma_azimuth_deg)]);
