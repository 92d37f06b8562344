// A plot in SVG: points, a line through them, error bars, and a circle around the selected point.
import { number, svg } from "./dom.js";

const WIDE = 480, LEFT = 58, RIGHT = 12, TOP = 12, BELOW = 44;

function ticks(low, high) {
  const rough = (high - low) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const places = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + 1e-9 * step; tick += step) places.push(Number(tick.toPrecision(12)));
  return places;
}

function range(values, whole) {
  let low = Math.min(...values), high = Math.max(...values);
  if (whole) { low = Math.min(low, 0); high = Math.max(high, 0); }
  const spare = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - spare, high + spare];
}

// points: [{x, y, low?, high?, flagged?, now?, title?}]; options: {x, y: names with units, line, choose(index), zero}
export function plot(figure, points, options) {
  const HIGH = options.high ?? 300;
  const shown = points.map((point, index) => ({ ...point, index })).filter((p) => p.x !== null && p.y !== null && p.y !== undefined);
  const frame = svg("svg", { class: "plot", viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img" });
  frame.setAttribute("aria-label", `${options.y} against ${options.x}, ${shown.length} points`);
  if (shown.length) {
    const [x0, x1] = range(shown.map((p) => p.x), options.zero);
    const [y0, y1] = range(shown.flatMap((p) => [p.y, p.low ?? p.y, p.high ?? p.y]), options.zero);
    const toX = (x) => LEFT + (x - x0) / (x1 - x0) * (WIDE - LEFT - RIGHT);
    const toY = (y) => HIGH - BELOW - (y - y0) / (y1 - y0) * (HIGH - TOP - BELOW);
    for (const tick of ticks(x0, x1)) frame.append(
      svg("line", { class: "grid", x1: toX(tick), x2: toX(tick), y1: TOP, y2: HIGH - BELOW }),
      svg("text", { x: toX(tick), y: HIGH - BELOW + 18, "text-anchor": "middle" }, number(tick, 4)));
    for (const tick of ticks(y0, y1)) frame.append(
      svg("line", { class: "grid", x1: LEFT, x2: WIDE - RIGHT, y1: toY(tick), y2: toY(tick) }),
      svg("text", { x: LEFT - 6, y: toY(tick) + 4, "text-anchor": "end" }, number(tick, 4)));
    if (options.line !== false) frame.append(svg("polyline", { class: "line", points: shown.map((p) => `${toX(p.x)},${toY(p.y)}`).join(" ") }));
    for (const p of shown) {
      if (p.low !== undefined && p.low !== null) frame.append(svg("line", { class: "bar", x1: toX(p.x), x2: toX(p.x), y1: toY(p.low), y2: toY(p.high) }));
      const dot = svg("circle", { class: p.flagged ? "dot flagged" : "dot", cx: toX(p.x), cy: toY(p.y), r: options.small ? 2 : 4 });
      dot.append(svg("title", {}, p.title ?? `${number(p.x)}, ${number(p.y)}`));
      if (options.choose) dot.addEventListener("click", () => options.choose(p.index));
      frame.append(dot);
      if (p.now) frame.append(svg("circle", { class: "now", cx: toX(p.x), cy: toY(p.y), r: 8 }));
    }
  }
  frame.append(
    svg("text", { x: (WIDE + LEFT) / 2, y: HIGH - 6, "text-anchor": "middle" }, options.x),
    svg("text", { x: 14, y: (HIGH - BELOW) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(HIGH - BELOW) / 2})` }, options.y));
  figure.replaceChildren(frame);
  return frame;
}
