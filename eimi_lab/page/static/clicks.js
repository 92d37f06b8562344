// Points that a person sets on a picture. A loupe enlarges the picture around the pointer.
import { el, svg } from "./dom.js";

const LOUPE_PX = 168, SEEN_PX = 28; // width of the loupe on the screen, and width of the part of the picture in the loupe
const FINGER_PX = 18; // radius on the screen that a finger can touch
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// Calls moved(event, start) while `made` is dragged. start is the event with which the drag began.
// Chromium ignores touch-action within an SVG, and would scroll without preventDefault.
export function draggable(made, moved) {
  let start = null;
  made.addEventListener("pointerdown", (event) => { made.setPointerCapture(event.pointerId); start = event; });
  made.addEventListener("pointermove", (event) => { if (made.hasPointerCapture(event.pointerId)) moved(event, start); });
  made.addEventListener("touchstart", (event) => {
    if (event.touches.length > 1) return;
    event.preventDefault();
    made.focus({ preventScroll: true });
  }, { passive: false });
}

export class Clicks {
  // names() returns the name of each point in the order of the clicks; further clicks are ignored. changed() is called after a point was set, moved or removed.
  constructor(picture, names, changed) {
    Object.assign(this, { picture, names, changed, points: [], undone: [], size: null, cursor: null });
    this.marks = svg("g");
    this.cross = svg("path", { class: "cross", "aria-hidden": "true" });
    picture.over.append(this.marks, this.cross);
    this.loupe = el("canvas", { class: "loupe", width: LOUPE_PX, height: LOUPE_PX, hidden: true, "aria-hidden": "true" });
    const { figure } = picture;
    figure.append(this.loupe);
    figure.classList.add("clickable");
    for (const [key, value] of Object.entries({ tabindex: 0, role: "application", "aria-label": "picture: arrow keys move the cross, with Shift by one pixel; Enter sets a point, Backspace removes the last point, Ctrl+Y sets it again" })) figure.setAttribute(key, value);
    figure.addEventListener("pointermove", (event) => { if (event.pointerType === "mouse" && !event.target.closest(".mark, .handle")) this.look(this.placeOf(event)); });
    figure.addEventListener("pointerleave", () => this.look(null));
    figure.addEventListener("click", (event) => { if (this.size && !event.target.closest(".mark, .handle")) this.add(this.placeOf(event)); });
    figure.addEventListener("keydown", (event) => this.key(event));
  }

  // size: width and height of the picture, px; null without a picture.
  begin(size, points = []) {
    this.size = size;
    if (points !== this.points) this.undone = [];
    this.points = points;
    this.cursor = null;
    this.draw();
  }

  placeOf(event) {
    const box = this.picture.over.getBoundingClientRect(), { pxPerScreenPx: scale } = this;
    return this.inside([(event.clientX - box.left) * scale - 0.5, (event.clientY - box.top) * scale - 0.5]);
  }

  get pxPerScreenPx() { return (this.size ?? [1])[0] / this.picture.over.getBoundingClientRect().width; }

  inside([x, y]) {
    const [wide, high] = this.size;
    return [Math.min(wide - 1, Math.max(0, x)), Math.min(high - 1, Math.max(0, y))].map((value) => Math.round(10 * value) / 10);
  }

  add(place) {
    if (this.points.length >= this.names().length) return;
    this.points.push(place);
    this.undone = [];
    this.draw();
    this.changed();
  }

  undo() { this.transfer(this.points, this.undone); }

  // Sets the point again that was removed last, also after clear().
  redo() { this.transfer(this.undone, this.points); }

  transfer(from, to) {
    if (!from.length) return;
    to.push(from.pop());
    this.draw();
    this.changed();
  }

  clear() {
    this.undone.push(...this.points.reverse());
    this.points = [];
    this.draw();
    this.changed();
  }

  key(event) {
    if (!this.size || event.target !== this.picture.figure) return;
    const way = WAYS[event.key], [wide, high] = this.size;
    if (way) {
      const far = event.shiftKey ? 1 : Math.max(1, Math.round(wide / 100)), [x, y] = this.cursor ?? [wide / 2, high / 2];
      this.cursor = this.inside([x + far * way[0], y + far * way[1]]);
      this.drawCross();
      this.look(this.cursor);
    } else if (event.key === "Enter" && this.cursor) this.add(this.cursor);
    else if (event.ctrlKey && (event.key === "y" || event.key === "Z")) this.redo();
    else if (event.key === "Backspace" || (event.key === "z" && event.ctrlKey)) this.undo();
    else return;
    event.preventDefault();
  }

  move(index, place) {
    this.points[index] = this.inside(place);
    this.draw(index);
    this.look(this.points[index]);
    this.changed();
  }

  draw(focused = -1) {
    const held = focused >= 0 && this.marks.children[focused]; // this element is kept, so that it keeps the focus and the pointer
    if (held && this.marks.childElementCount === this.points.length) this.place(held, focused);
    else this.marks.replaceChildren(...this.points.map((_, index) => this.place(this.mark(index), index)));
    this.drawCross();
  }

  mark(index) {
    const made = svg("g", { class: "mark", tabindex: 0, role: "button", "aria-label": `${this.names()[index]}: drag, or arrow keys` },
      svg("circle", { class: "grip" }), svg("circle", { class: "area" }), svg("circle", { class: "dot", r: 1 }), svg("text", {}, String(index + 1)));
    let from = null; // the point and the event at the start of the drag: the point keeps its distance from the finger
    draggable(made, (event, start) => {
      if (from?.start !== start) from = { start, point: this.points[index] };
      const { pxPerScreenPx: scale } = this, [x, y] = from.point;
      this.move(index, [x + (event.clientX - start.clientX) * scale, y + (event.clientY - start.clientY) * scale]);
    });
    made.addEventListener("keydown", (event) => {
      const way = WAYS[event.key];
      if (!way) return;
      event.preventDefault();
      const far = event.shiftKey ? 10 : 1, [x, y] = this.points[index];
      this.move(index, [x + far * way[0], y + far * way[1]]);
    });
    return made;
  }

  place(mark, index) {
    const radius = 0.011 * this.size[0] + 3, [x, y] = this.points[index];
    mark.setAttribute("transform", `translate(${x} ${y})`);
    const [grip, area] = mark.children;
    grip.setAttribute("r", matchMedia("(pointer: coarse)").matches ? Math.max(radius, FINGER_PX * this.pxPerScreenPx) : radius);
    area.setAttribute("r", radius);
    mark.lastChild.setAttribute("font-size", 1.3 * radius);
    mark.lastChild.setAttribute("x", 1.7 * radius);
    mark.lastChild.setAttribute("y", -1.2 * radius);
    return mark;
  }

  drawCross() {
    this.cross.setAttribute("d", this.cursor && this.size ? `M${this.cursor[0]} 0V${this.size[1]}M0 ${this.cursor[1]}H${this.size[0]}` : "");
  }

  look(place) {
    this.loupe.hidden = !place || !this.size;
    if (this.loupe.hidden) return;
    const drawn = this.loupe.getContext("2d"), { canvas } = this.picture;
    const share = canvas.width / this.size[0], seen = SEEN_PX * Math.max(1, this.size[0] / 1600), [x, y] = place;
    drawn.imageSmoothingEnabled = false;
    drawn.fillRect(0, 0, LOUPE_PX, LOUPE_PX);
    drawn.drawImage(canvas, (x + 0.5 - seen / 2) * share, (y + 0.5 - seen / 2) * share, seen * share, seen * share, 0, 0, LOUPE_PX, LOUPE_PX);
    for (const [colour, wide] of [["#000", 3], ["#fff", 1]]) {
      Object.assign(drawn, { strokeStyle: colour, lineWidth: wide });
      drawn.beginPath();
      for (const [from, to] of [[0, 0.42], [0.58, 1]]) {
        drawn.moveTo(from * LOUPE_PX, LOUPE_PX / 2); drawn.lineTo(to * LOUPE_PX, LOUPE_PX / 2);
        drawn.moveTo(LOUPE_PX / 2, from * LOUPE_PX); drawn.lineTo(LOUPE_PX / 2, to * LOUPE_PX);
      }
      drawn.stroke();
    }
    this.loupe.classList.toggle("right", x < this.size[0] / 2); // the loupe does not cover the point
  }
}
