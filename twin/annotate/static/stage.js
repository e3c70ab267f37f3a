/* The picture with its marks and proposals, and what a pointer does in it. */

import { byId } from "./dom.js";

const REACH = 14;
const SMALLEST = 4;
const LOUPE = 5;
const CLICKED = "#f0c36a";
const SEEN = "#8ec5ff";
const PROPOSED = "#2fc59e";
const OTHERS = "#b3bdc8";

export class Stage {
  /** `acts.foot(point, sign)`, `acts.box(edges, sign)`: what the person put, in the picture's pixels. */
  constructor(acts) {
    this.acts = acts;
    this.canvas = byId("canvas");
    this.loupe = byId("loupe");
    this.mode = "foot";
    this.sign = "";
    this.image = null;
    this.record = { marks: [], proposals: [] };
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.canvas.addEventListener("pointerdown", (event) => this.down(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.up(event));
    this.canvas.addEventListener("pointerleave", () => (this.loupe.hidden = true));
  }

  show(image, record) {
    this.image = image;
    this.record = record;
    this.drag = null;
    this.draw();
    // Else it goes on showing the picture of before.
    if (!this.loupe.hidden && this.last) this.look(this.last, this.inPicture(this.last));
  }

  /** How the picture lies in the canvas: the centre of its first pixel is (0, 0). */
  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const scale = Math.min(width / this.image.width, height / this.image.height);
    return { scale, left: (width - this.image.width * scale) / 2, top: (height - this.image.height * scale) / 2 };
  }

  onScreen([x, y]) {
    const { scale, left, top } = this.fit();
    return [left + (x + 0.5) * scale, top + (y + 0.5) * scale];
  }

  inPicture(event) {
    const { scale, left, top } = this.fit();
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left - left) / scale - 0.5, (event.clientY - box.top - top) / scale - 0.5];
  }

  isInside([x, y]) {
    return x >= -0.5 && y >= -0.5 && x <= this.image.width - 0.5 && y <= this.image.height - 0.5;
  }

  /** The foot, proposed or marked here, that lies under a point. */
  under(point) {
    const { scale } = this.fit();
    const feet = [...this.record.marks.filter((one) => !one.file), ...this.record.proposals].filter((one) => one.kind === "foot");
    const away = (one) => Math.hypot(one.place_px[0] - point[0], one.place_px[1] - point[1]) * scale;
    return feet.filter((one) => away(one) < REACH).sort((a, b) => away(a) - away(b))[0];
  }

  down(event) {
    if (!this.image || event.button !== 0) return;
    const point = this.inPicture(event);
    if (!this.isInside(point)) return;
    this.canvas.setPointerCapture(event.pointerId);
    const held = this.mode === "foot" ? this.under(point) : null;
    this.drag = { from: point, to: point, sign: held?.object ?? this.sign };
    this.look(event, point);
  }

  move(event) {
    if (!this.image) return;
    const point = this.inPicture(event);
    if (this.drag) this.drag.to = point;
    this.draw();
    this.look(event, point);
  }

  up(event) {
    if (!this.drag) return;
    const { from, sign } = this.drag;
    const to = this.inPicture(event);
    this.drag = null;
    if (this.mode === "foot") {
      if (this.isInside(to)) this.acts.foot(to, sign);
    } else {
      const edges = [Math.min(from[0], to[0]), Math.min(from[1], to[1]), Math.max(from[0], to[0]), Math.max(from[1], to[1])];
      edges[0] = Math.max(edges[0], 0);
      edges[1] = Math.max(edges[1], 0);
      edges[2] = Math.min(edges[2], this.image.width - 1);
      edges[3] = Math.min(edges[3], this.image.height - 1);
      if (edges[2] - edges[0] >= SMALLEST && edges[3] - edges[1] >= SMALLEST) this.acts.box(edges, sign);
    }
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const density = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * density;
    canvas.height = canvas.clientHeight * density;
    const pen = canvas.getContext("2d");
    pen.scale(density, density);
    if (!this.image) return;
    const { scale, left, top } = this.fit();
    pen.drawImage(this.image, left, top, this.image.width * scale, this.image.height * scale);
    for (const one of this.record.proposals) this.shape(pen, one, PROPOSED, true);
    for (const one of this.record.marks) this.shape(pen, one, one.file ? OTHERS : one.is_measured ? CLICKED : SEEN, false);
    if (this.drag) {
      const { from, to } = this.drag;
      const place = this.mode === "foot" ? to : [...from, ...to];
      this.shape(pen, { kind: this.mode, place_px: place, object: "" }, CLICKED, false);
    }
  }

  shape(pen, { kind, place_px: place, object, radius_px: radius }, colour, isProposed) {
    const isChosen = object === this.sign;
    pen.lineWidth = isChosen ? 3 : 1.5;
    pen.setLineDash(isProposed ? [6, 4] : []);
    pen.font = "600 13px sans-serif";
    // Drawn twice, so that it shows on bright and dark ground.
    for (const [style, wider] of [["#000a", 2], [colour, 0]]) {
      pen.strokeStyle = style;
      pen.fillStyle = style;
      pen.lineWidth = (isChosen ? 2.5 : 1.5) + wider;
      pen.beginPath();
      const [x, y] = this.onScreen(place.slice(0, 2));
      if (kind === "foot") {
        const arm = 11;
        for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
          pen.moveTo(x + dx * 3, y + dy * 3);
          pen.lineTo(x + dx * arm, y + dy * arm);
        }
        if (isProposed) {
          const r = Math.max(radius * this.fit().scale, 5);
          pen.moveTo(x + r, y);
          pen.arc(x, y, r, 0, 2 * Math.PI);
        }
      } else {
        const [right, bottom] = this.onScreen(place.slice(2));
        pen.rect(x, y, right - x, bottom - y);
      }
      pen.stroke();
      if (object && kind === "foot") pen.fillText(object, x + 13, y + 16 + wider / 2);
    }
    pen.setLineDash([]);
  }

  /** The pixels under the pointer, enlarged. */
  look(event, [x, y]) {
    this.last = event;
    this.loupe.hidden = !this.isInside([x, y]);
    const box = this.canvas.getBoundingClientRect();
    const isLeft = event.clientX - box.left < 280;
    this.loupe.style.left = isLeft ? "auto" : "10px";
    this.loupe.style.right = isLeft ? "10px" : "auto";
    const pen = this.loupe.getContext("2d");
    const half = this.loupe.width / 2;
    pen.imageSmoothingEnabled = false;
    pen.fillStyle = "#11161c";
    pen.fillRect(0, 0, 2 * half, 2 * half);
    pen.drawImage(this.image, half - (x + 0.5) * LOUPE, half - (y + 0.5) * LOUPE, this.image.width * LOUPE, this.image.height * LOUPE);
    pen.strokeStyle = CLICKED;
    pen.beginPath();
    for (const [from, to] of [[-30, -4], [4, 30]]) {
      pen.moveTo(half + from, half);
      pen.lineTo(half + to, half);
      pen.moveTo(half, half + from);
      pen.lineTo(half, half + to);
    }
    pen.stroke();
  }
}
