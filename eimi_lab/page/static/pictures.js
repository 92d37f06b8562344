// The view "Pictures": a person drags clamp, axis and ruler into place; the edges are found again at once.
import { Clicks, draggable } from "./clicks.js";
import { ask, askPicture, byId, el, flagList, number, post, svg, tell, tellError, tried } from "./dom.js";
import { steer } from "./live.js";
import { Picture } from "./picture.js";
import { openRun } from "./runs.js";

const FIELDS = { scale: "pixels_per_mm", axis: "axis_angle_deg", gravity: "gravity_angle_deg", field: "field_angle_deg", "coil-constant": "coil_constant_mT_per_A" };
const WAIT_MS = 120, MOST_ALONG = 6, FILES = 2; // the files are calibration.toml and states.csv
const picture = new Picture(byId("by-hand"));
const stated = svg("g", { "aria-hidden": "true" }), handles = svg("g");
picture.over.append(stated, handles);
const along_points = new Clicks(picture, () => isFirst() ? Array.from({ length: MOST_ALONG }, (_, index) => `point ${index + 1} along the beam`) : [], () => { tellPoints(); later(); });

let folder = null; // { name, pictures, size_px, calibration, … }
let saved = ""; // the values that are in the files of the folder; empty if a file is missing
let shown = "", ruler = null, reach = 100, asked = 0, waiting = null, ready = false;

export async function showPictures() {
  if (ready) return;
  ready = true;
  const [folders, choices] = await Promise.all([ask("/api/pictures/folders"), ask("/api/choices")]);
  byId("picture-folder").replaceChildren(...folders.map((name) => el("option", { value: name }, name || "(this folder)")));
  byId("picture-specimen").replaceChildren(...choices.specimen.map((name) => el("option", { value: name }, name)));
  if (folders.length) await openFolder();
  else byId("by-hand-words").textContent = "No folder contains pictures.";
}

async function openFolder() {
  const name = byId("picture-folder").value;
  byId("picture-list").replaceChildren(); // the inputs belong to the previous folder
  byId("by-hand-words").textContent = "";
  asked += 1;
  shown = ""; // a late answer or picture of the previous folder is not shown
  const opened = await ask("/api/pictures", { folder: name });
  if (byId("picture-folder").value !== name) return;
  folder = { name, ...opened };
  const { calibration, size_px: [wide, high] } = folder;
  for (const [id, key] of Object.entries(FIELDS)) byId(id).value = calibration[key];
  [byId("clamp-x").value, byId("clamp-y").value] = calibration.clamp_midpoint_px;
  byId("channel").value = calibration.picture?.channel ?? "";
  byId("polarity").value = calibration.picture?.polarity ?? "";
  reach = 0.45 * high;
  const long = 10 * calibration.pixels_per_mm;
  byId("ruler-mm").value = 10;
  ruler = [[0.08 * wide, 0.92 * high], [0.08 * wide + long, 0.92 * high]];
  listPictures();
  points = folder.calibration.picture?.along_px ?? [];
  saved = folder.written.length === FILES ? onScreen() : "";
  await showPicture(folder.pictures[0]);
}

const isFirst = () => shown === folder?.pictures[0]; // points along the beam are set only on the first picture
let points = []; // the points on the first picture, kept while another picture is shown

function tellPoints() {
  if (isFirst()) points = along_points.points;
  byId("along-words").textContent = points.length === 1 ? "one more point is needed" : points.length ? `${points.length} points along the beam` : "";
  byId("along-undo").disabled = !isFirst() || !points.length;
}

function listPictures() {
  byId("picture-list").replaceChildren(...folder.pictures.map((name) => el("p", {},
    el("button", { type: "button", onclick: tried(() => showPicture(name)), "aria-current": String(name === shown) }, name),
    el("input", { name, inputmode: "decimal", "aria-label": `current of ${name}, A`, value: folder.currents[name] ?? folder.currents[name.replace(/\.\w+$/, "")] ?? "" }))));
}

async function showPicture(name) {
  shown = name;
  for (const button of byId("picture-list").querySelectorAll("button")) button.setAttribute("aria-current", String(button.textContent === name));
  const of = folder, blob = await askPicture("/api/pictures/picture", { folder: of.name, picture: name });
  if (shown !== name || folder !== of) return;
  await picture.show(blob, of.size_px, name);
  if (shown !== name || folder !== of) return;
  along_points.begin(folder.size_px, isFirst() ? points : []);
  tellPoints();
  drawHandles();
  await findEdges();
}

const value = (id) => Number(byId(id).value);
const typed = (id) => byId(id).value === "" ? null : value(id); // an empty field has no value; it is not zero
const set = (id, number_, digits = 2) => { byId(id).value = Number(number_.toFixed(digits)); };
const clamp = () => [value("clamp-x"), value("clamp-y")];
const along = (from, degrees, far) => [from[0] + far * Math.cos(degrees * Math.PI / 180), from[1] + far * Math.sin(degrees * Math.PI / 180)];

function calibration() {
  const made = Object.fromEntries(Object.entries(FIELDS).map(([id, key]) => [key, typed(id)]));
  made.clamp_midpoint_px = [typed("clamp-x"), typed("clamp-y")];
  const help = Object.fromEntries(["channel", "polarity"].filter((id) => byId(id).value).map((id) => [id, byId(id).value]));
  made.picture = { ...help, along_px: points.length > 1 ? points : null };
  return made;
}

// The handles: at() returns the position of a handle, to() applies a new one.
const HANDLES = [
  { sign: "✚", name: "middle of the clamp", at: clamp, to: ([x, y]) => { set("clamp-x", x); set("clamp-y", y); } },
  { sign: "➤", name: "direction of the straight beam", at: () => along(clamp(), value("axis"), reach), to: ([x, y]) => {
    const [cx, cy] = clamp(), turned = Math.atan2(y - cy, x - cx) * 180 / Math.PI;
    const side = Math.sin((value("field") - value("axis")) * Math.PI / 180) < 0 ? -90 : 90;
    reach = Math.max(20, Math.hypot(x - cx, y - cy));
    set("axis", turned);
    set("field", turned + side); // the field stays perpendicular to the beam, on the same side
  } },
  { sign: "◆", name: "first end of the ruler", at: () => ruler[0], to: (place) => { ruler[0] = place; measure(); } },
  { sign: "◆", name: "second end of the ruler", at: () => ruler[1], to: (place) => { ruler[1] = place; measure(); } },
];

function measure() {
  const length = Math.hypot(ruler[1][0] - ruler[0][0], ruler[1][1] - ruler[0][1]);
  if (value("ruler-mm") > 0 && length > 0) set("scale", length / value("ruler-mm"), 4);
}

function drawHandles() {
  const size = 0.022 * folder.size_px[0] + 4;
  if (!handles.childElementCount) handles.append(...HANDLES.map((handle) => {
    const made = svg("g", { class: "handle", tabindex: 0, role: "button", "aria-label": `${handle.name}: drag, or arrow keys` },
      svg("circle", { class: "area" }), svg("text", {}, handle.sign));
    draggable(made, (event) => move(handle, placeOf(event)));
    made.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!way) return;
      event.preventDefault();
      const far = event.shiftKey ? 10 : 1, [x, y] = handle.at();
      move(handle, [x + far * way[0], y + far * way[1]]);
    });
    return made;
  }));
  HANDLES.forEach((handle, index) => {
    const [x, y] = handle.at(), made = handles.children[index];
    made.setAttribute("transform", `translate(${x} ${y})`);
    made.firstChild.setAttribute("r", size);
    made.lastChild.setAttribute("font-size", size);
  });
  const half = 4 * value("scale"), [a, b] = [clamp(), along(clamp(), value("axis"), reach)];
  const line = (from, to) => svg("polyline", { class: "stated", points: `${from.join(",")} ${to.join(",")}` });
  stated.replaceChildren(line(a, b), line(...ruler), line(along(a, value("axis") + 90, half), along(a, value("axis") - 90, half)));
}

function placeOf(event) {
  const box = picture.over.getBoundingClientRect(), [wide, high] = folder.size_px;
  return [(event.clientX - box.left) / box.width * wide - 0.5, (event.clientY - box.top) / box.height * high - 0.5];
}

function move(handle, [x, y]) {
  const [wide, high] = folder.size_px;
  handle.to([Math.min(wide - 1, Math.max(0, x)), Math.min(high - 1, Math.max(0, y))]);
  drawHandles();
  later();
}

function later() {
  clearTimeout(waiting);
  waiting = setTimeout(() => findEdges().catch(tellError), WAIT_MS);
}

async function findEdges() {
  if (!shown) return;
  const mine = ++asked;
  const body = { folder: folder.name, picture: shown, specimen: byId("picture-specimen").value, calibration: calibration() };
  try {
    const edges = await post("/api/pictures/edges", body);
    if (mine !== asked) return;
    picture.draw(edges);
    flagList(byId("by-hand-flags"), edges.flags);
    const points = edges.left.length + edges.right.length;
    byId("by-hand-words").textContent = points ? `edges found: ${points} points, blur σ ${number(edges.blur_px)} px, tip at ${number(edges.tip_angle_deg)}°` : "no edges found; the flags below give the reason";
    byId("by-hand").dataset.points = points;
  } catch (error) {
    if (mine === asked) { picture.draw(null); byId("by-hand-words").textContent = error.message; }
  }
}

function currents() {
  return Object.fromEntries([...byId("picture-list").querySelectorAll("input")].map((input) => [input.name, input.value]));
}

const onScreen = () => JSON.stringify([calibration(), currents()]);

byId("along-undo").addEventListener("click", () => along_points.undo());
byId("picture-folder").addEventListener("change", tried(openFolder));
byId("picture-specimen").addEventListener("change", later);
byId("ruler-mm").addEventListener("input", () => { measure(); drawHandles(); later(); });
for (const id of [...Object.keys(FIELDS), "clamp-x", "clamp-y", "channel", "polarity"]) {
  byId(id).addEventListener("input", () => { if (folder) { drawHandles(); later(); } });
}
byId("calibration").addEventListener("submit", tried(async () => {
  if (folder?.name !== byId("picture-folder").value) throw new Error("the folder is still being opened");
  const body = { folder: folder.name, calibration: calibration(), currents: currents(), replace: byId("replace").checked };
  const values = onScreen();
  const { written, states } = await steer("/api/pictures/save", body);
  saved = values;
  tell(`saved ${written.join(" and ")} in ${folder.name || "this folder"}: ${states} pictures have a current`);
}));
byId("make-dataset").addEventListener("click", tried(async () => {
  if (onScreen() !== saved) throw new Error("the values on the screen are not in the files of the folder; press Save first");
  tell("making the dataset …");
  const { dataset, states } = await steer("/api/pictures/dataset",
    { folder: folder.name, specimen: byId("picture-specimen").value, replace: byId("replace").checked });
  location.hash = "#runs";
  await openRun(dataset);
  tell(`${dataset}: ${states} states`);
}));
