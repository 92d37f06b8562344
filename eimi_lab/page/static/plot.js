// A plot in SVG: points, a line through them, error bars, and a circle around the selected point.
import { number, svg } from "./dom.js";

const WIDE = 480, RIGHT = 12, TOP = 12, BELOW = 44;
const TITLE = 30, DIGIT = 7.5; // widths of the rotated title of the y axis with its gap, and of a digit

// Return about `many` ticks from low to high, each with its value and its label. whole: only whole numbers.
function ticks(low, high, many, whole) {
  const rough = Math.max((high - low) / many, whole ? 1 : 0);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), made = [];
  for (let count = Math.ceil(low / step - 1e-9); count * step <= high + 1e-9 * step; count++)
    made.push({ at: count * step, label: Math.abs(count * step) >= 1e6 ? number(count * step, 4) : (count * step + 0).toFixed(Math.min(decimals, 20)) });
  return made;
}

const longest = (made) => Math.max(1, ...made.map(({ label }) => label.length));

function range(values, zero) {
  let low = Math.min(...values), high = Math.max(...values);
  if (zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
  const spare = high > low ? (high - low) * 0.06 : Math.abs(high) || 1; // a single value stands in the middle
  return [low - spare, high + spare];
}

// points: [{x, y, low? and high?: ends of the error bar, flagged?, now?: selected, title?}];
// options: {x, y: titles of the axes, line: false for no line, choose(index): called by a click, zero: include 0, whole: x is a count, high: height, small: small points}
export function plot(figure, points, options) {
  const HIGH = options.high ?? 300;
  const shown = points.map((point, index) => ({ ...point, index })).filter((p) => p.x !== null && p.y !== null && p.y !== undefined);
  const frame = svg("svg", { class: "plot", viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img" });
  frame.setAttribute("aria-label", `${options.y} against ${options.x}, ${shown.length} points`);
  if (shown.length) {
    const [x0, x1] = range(shown.map((p) => p.x), options.zero);
    const [y0, y1] = range(shown.flatMap((p) => [p.y, p.low ?? p.y, p.high ?? p.y]), options.zero);
    const xTicks = [7, 6, 5, 4, 3, 2, 1].map((many) => ticks(x0, x1, many, options.whole)).find((made) => made.length * (longest(made) + 2) * DIGIT < WIDE - 120) ?? [];
    const yTicks = ticks(y0, y1, 5);
    const LEFT = TITLE + DIGIT * longest(yTicks);
    const toX = (x) => LEFT + (x - x0) / (x1 - x0) * (WIDE - LEFT - RIGHT);
    const toY = (y) => HIGH - BELOW - (y - y0) / (y1 - y0) * (HIGH - TOP - BELOW);
    for (const { at, label } of xTicks) frame.append(
      svg("line", { class: "grid", x1: toX(at), x2: toX(at), y1: TOP, y2: HIGH - BELOW }),
      svg("text", { class: "tick", x: toX(at), y: HIGH - BELOW + 18, "text-anchor": "middle" }, label));
    for (const { at, label } of yTicks) frame.append(
      svg("line", { class: "grid", x1: LEFT, x2: WIDE - RIGHT, y1: toY(at), y2: toY(at) }),
      svg("text", { class: "tick", x: LEFT - 6, y: toY(at) + 4, "text-anchor": "end" }, label));
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
    svg("text", { class: "title", x: (WIDE + TITLE) / 2, y: HIGH - 6, "text-anchor": "middle" }, options.x),
    svg("text", { class: "title", x: 14, y: (HIGH - BELOW) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(HIGH - BELOW) / 2})` }, options.y));
  figure.replaceChildren(frame);
  return frame;
}
