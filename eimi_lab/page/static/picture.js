// A picture with the edges of the beam drawn over it. Edges are given in pixels of the original picture.
import { el, svg } from "./dom.js";

export class Picture {
  asked = 0; drawn = 0; // numbers of the newest picture, and of the newest one on the screen

  constructor(figure) {
    this.figure = figure;
    this.canvas = el("canvas", { width: 4, height: 3, role: "img", "aria-label": "no picture yet" });
    this.over = svg("svg", { preserveAspectRatio: "none" });
    this.edges = svg("g", { "aria-hidden": "true" });
    this.over.append(this.edges);
    figure.replaceChildren(this.canvas, this.over);
  }

  // size: width and height of the original picture, px, if blob is a reduced copy. Returns false if a later picture is on the screen, or clear() was called.
  async show(blob, size = null, words = "") {
    const mine = ++this.asked, image = await createImageBitmap(blob);
    if (mine <= this.drawn) return false;
    this.drawn = mine;
    const { width, height } = image;
    this.figure.hidden = false;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.canvas.getContext("2d").drawImage(image, 0, 0);
    image.close();
    const [wide, high] = size ?? [width, height];
    this.over.setAttribute("viewBox", `-0.5 -0.5 ${wide} ${high}`); // pixel centres lie at whole numbers
    if (words) this.canvas.setAttribute("aria-label", words);
    return true;
  }

  clear() {
    this.drawn = this.asked;
    this.figure.hidden = true;
    this.canvas.setAttribute("aria-label", "no picture yet");
    this.draw(null);
  }

  draw(edges) {
    const lines = edges ? ["left", "right"].filter((side) => edges[side].length).map((side) =>
      svg("polyline", { class: `edge ${side}`, points: edges[side].map((point) => point.join(",")).join(" ") })) : [];
    this.edges.replaceChildren(...lines);
  }
}
