/* What all maps share: MapLibre on a plain ground, our own buttons, the marks, the base map once it is switched on. */

import { fill, h, svg } from "./dom.js";
import { DRIVE_COLOUR, MARKS, NVDB_COLOUR, pathOf, pixels, SEEN_COLOUR } from "./marks.js";
import { say } from "./words.js";

const VENDOR = "./vendor/maplibre-gl-6.17.0";
const CAMERA = "M12 1l9 20l-9-5l-9 5z";
const CROSS = "M9.5 1h5v8.5h8.5v5h-8.5v8.5h-5v-8.5h-8.5v-5h8.5z";
const DIAMOND = "M12 1l11 11l-11 11l-11-11z";
const dark = matchMedia("(prefers-color-scheme: dark)");

let library;

/** MapLibre, loaded when first needed: it is larger than everything else together. */
export async function maplibre() {
  if (!library) {
    const sheet = h("link", { rel: "stylesheet", href: new URL(`${VENDOR}/maplibre-gl.css`, import.meta.url).href });
    document.head.prepend(sheet);
    library = import(`${VENDOR}/maplibre-gl.mjs`);
  }
  return library;
}

export const isDark = () => dark.matches;
const ground = () => (dark.matches ? "#1d232b" : "#eef0ee");

/**
 * A map in `place` with its buttons; rejects where the browser has no WebGL.
 *
 * @param {HTMLElement} place
 * @param {{baseMap: object | null, label: string, homeLabel?: string, onhome: () => void}} options
 */
export async function makeMap(place, { baseMap, label, homeLabel = say("page.map.home"), onhome }) {
  const { Map: MapLibre, ScaleControl } = await maplibre();
  const canvas = h("div", { class: "canvas" });
  const button = (text, title, onclick, more = {}) => h("button", { type: "button", title, "aria-label": title, onclick, ...more }, text);
  place.replaceChildren(canvas);
  const map = new MapLibre({
    container: canvas,
    style: { version: 8, sources: {}, layers: [{ id: "ground", type: "background", paint: { "background-color": ground() } }] },
    center: [10.4, 63.4],
    zoom: 4,
    maxZoom: 23,
    attributionControl: false,
    dragRotate: false,
    pitchWithRotate: false,
    touchPitch: false,
    fadeDuration: 0,
    locale: { "Map.Title": label },
  });
  map.touchZoomRotate.disableRotation();
  map.addControl(new ScaleControl({ maxWidth: 90 }), "bottom-left");
  const credit = h("p", { class: "credit", hidden: true }, baseMap?.attribution);
  place.append(
    h(
      "div",
      { class: "map-buttons" },
      button("+", say("page.map.in"), () => map.zoomIn({ animate: false })),
      button("−", say("page.map.out"), () => map.zoomOut({ animate: false })),
      button(homeSign(), homeLabel, onhome),
      baseMap && baseMapButton(map, baseMap, credit),
    ),
    credit,
  );
  dark.addEventListener("change", () => map.setPaintProperty("ground", "background-color", ground()));
  await new Promise((resolve) => map.once("load", resolve));
  addMarks(map);
  new ResizeObserver(() => map.resize()).observe(canvas);
  return map;
}

const homeSign = () =>
  svg("svg", { viewBox: "0 0 24 24", width: 18, height: 18, "aria-hidden": "true" }, svg("path", { d: "M12 2v5M12 17v5M2 12h5M17 12h5M12 8a4 4 0 1 0 0 8a4 4 0 1 0 0-8z", fill: "none", stroke: "currentColor", "stroke-width": 2 }));

/** Only this button makes the page ask an outside host for anything. */
function baseMapButton(map, baseMap, credit) {
  const show = (isOn) => {
    if (isOn) {
      map.addSource("base", { type: "raster", tiles: [baseMap.url], tileSize: 256, maxzoom: 18 });
      map.addLayer({ id: "base", type: "raster", source: "base", paint: { "raster-fade-duration": 0, "raster-opacity": 0.85 } }, map.getStyle().layers[1]?.id);
    } else {
      map.removeLayer("base");
      map.removeSource("base");
    }
    credit.hidden = !isOn;
    button.setAttribute("aria-pressed", String(isOn));
  };
  const button = h("button", { type: "button", class: "base", "aria-pressed": "false", onclick: () => show(button.getAttribute("aria-pressed") !== "true") }, say("page.map.base"));
  return button;
}

function addMarks(map) {
  const add = (name, image) => map.addImage(name, image, { pixelRatio: 2 });
  for (const verdict of Object.keys(MARKS)) add(`verdict-${verdict}`, pixels(pathOf(verdict), MARKS[verdict].colour, 36));
  add("camera", pixels(CAMERA, DRIVE_COLOUR, 40));
  add("seen", pixels(CROSS, SEEN_COLOUR, 40, { width: 3 }));
  add("nvdb", pixels(DIAMOND, NVDB_COLOUR, 40, { width: 3 }));
}

/** What stands in place of a map where there is no WebGL. */
export function noMap(place) {
  fill(place, h("p", { class: "no-map" }, say("page.map.none")));
}
