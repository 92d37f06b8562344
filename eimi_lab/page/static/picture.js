// A picture with what was found in it drawn over it, in the picture's own pixels.
import { el, svg } from "./dom.js";

export class Picture {
  constructor(figure) {
    this.figure = figure;
    this.canvas = el("canvas", { width: 4, height: 3, role: "img", "aria-label": "no picture yet" });
    this.over = svg("svg", { preserveAspectRatio: "none" });
    this.edges = svg("g", { "aria-hidden": "true" });
    this.over.append(this.edges);
    figure.replaceChildren(this.canvas, this.over);
  }

  // size: of the picture itself, where the one shown was made smaller.
  async show(blob, size = null, words = "") {
    const image = await createImageBitmap(blob);
    const { width, height } = image;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.canvas.getContext("2d").drawImage(image, 0, 0);
    image.close();
    const [wide, high] = size ?? [width, height];
    this.over.setAttribute("viewBox", `-0.5 -0.5 ${wide} ${high}`); // pixel centres lie at whole numbers
    if (words) this.canvas.setAttribute("aria-label", words);
  }

  draw(found) {
    const lines = found ? ["left", "right"].filter((side) => found[side].length).map((side) =>
      svg("polyline", { class: `edge ${side}`, points: found[side].map((point) => point.join(",")).join(" ") })) : [];
    this.edges.replaceChildren(...lines);
  }
}
