// The view "Runs": the datasets of the folder. A dataset is opened read-only, also while a run writes it.
import { ask, askPicture, byId, el, facts, flagList, number, tell, tellError, tried, withSigma } from "./dom.js";
import { showFits } from "./fits.js";
import { Picture } from "./picture.js";
import { plot } from "./plot.js";

const AGAIN_MS = 2000;
const picture = new Picture(byId("run-picture"));
const slider = byId("state");
let folder = "";
let open = null; // { file, about: description, edges: by state, state: the selected one, number: counts the openings }
let openings = 0, listings = 0;

export async function showFolder(name = folder) {
  const mine = ++listings;
  const listing = await ask("/api/folder", { in: name });
  if (mine !== listings) return; // a later request was made
  folder = name;
  byId("where").textContent = name ? `${listing.root}/${name}` : listing.root;
  const rows = [];
  if (name) rows.push(entry("↑ folder above", () => showFolder(name.split("/").slice(0, -1).join("/")), false));
  for (const { name: file, kind, link } of listing.entries) {
    const short = file.split("/").pop();
    if (kind === "folder") rows.push(entry(`${short}/`, () => showFolder(file), false));
    if (kind === "dataset") rows.push(entry(short, () => openRun(file), open?.file === file));
    if (kind === "report") rows.push(el("li", {}, el("a", { href: link, target: "_blank" }, `${short} (report, opens in a new tab)`)));
  }
  byId("files").replaceChildren(...(rows.length ? rows : [el("li", {}, "There is no dataset in this folder.")]));
}

function entry(words, choose, current) {
  return el("li", {}, el("button", { type: "button", onclick: tried(choose), "aria-current": current }, words));
}

export async function openRun(file) {
  const mine = ++openings;
  const about = await ask("/api/dataset", { file });
  if (mine !== openings) return;
  open = { file, about, edges: [], state: 0, number: mine };
  picture.clear(); // the frame of the dataset that was open before
  tell("");
  const fits = showFits(file); // before the form is visible, because it shows the fits of this dataset
  byId("nothing-open").hidden = true;
  byId("open-run").hidden = false;
  showFacts();
  await Promise.all([showFolder(), showState(0), fits]);
  findEdges(open);
  watch(open);
}

function showFacts() {
  const { about, file } = open;
  byId("run-title").textContent = `${file}: ${about.specimen}`;
  facts(byId("run-facts"), [
    ["material", about.material],
    ["begun", new Date(about.begun).toLocaleString()],
    ["states", `${about.states.length} of ${about.states_asked}${about.being_written ? ", being written now" : ""}`],
    ["instruments", about.instruments.join("; ") || "imported"],
  ]);
  slider.max = Math.max(0, about.states.length - 1);
  drawPlot();
}

function drawPlot() {
  const points = open.about.states.map((state, index) => ({
    x: state.field_mT,
    y: open.edges[index]?.tip_angle_deg ?? null,
    flagged: flagsOf(index).length > 0,
    now: index === open.state,
    title: `state ${index}: ${number(state.field_mT)} mT, ${open.edges[index] ? withSigma(open.edges[index].tip_angle_deg ?? null, open.edges[index].tip_angle_sigma_deg, "°") : "—"}`,
  }));
  plot(byId("run-plot"), points, { x: "field, mT", y: "tip angle, degrees", choose: showState });
}

function flagsOf(index) {
  const flags = [...open.about.states[index].flags, ...(open.edges[index]?.flags ?? [])];
  return flags.filter((flag, at) => flags.findIndex((other) => other.name === flag.name) === at);
}

async function showState(index) {
  const run = open;
  const state = run.about.states[index];
  if (!state) { byId("state-words").textContent = "no state is stored yet"; return; }
  run.state = index;
  slider.value = index;
  byId("state-words").textContent = `${index}: ${number(state.current_A)} A, ${number(state.field_mT)} mT`;
  byId("state-before").disabled = index === 0;
  byId("state-next").disabled = index >= run.about.states.length - 1;
  showFound();
  if (run.about.kind !== "frames") return;
  const words = `state ${index} at ${number(state.field_mT)} mT`;
  const blob = await askPicture("/api/dataset/picture", { file: run.file, state: index });
  if (open === run && run.state === index) await picture.show(blob, null, words);
}

function showFound() {
  flagList(byId("run-flags"), flagsOf(open.state));
  picture.draw(open.edges[open.state]);
  drawPlot();
}

async function findEdges(run) {
  if (run.about.kind !== "frames") return;
  for (let index = 0; index < run.about.states.length; index++) {
    if (open !== run) return;
    if (run.edges[index]) continue;
    try {
      run.edges[index] = await ask("/api/dataset/edges", { file: run.file, state: index });
    } catch (error) {
      tellError(error);
      return;
    }
    if (open === run) { if (run.state === index) showFound(); else drawPlot(); }
  }
}

async function watch(run) {
  while (open === run && run.about.being_written) {
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    if (open !== run) return;
    try {
      const before = run.about.states.length;
      run.about = await ask("/api/dataset", { file: run.file });
      showFacts();
      if (!before) await showState(0);
      if (run.about.states.length > before) await findEdges(run);
    } catch (error) {
      tellError(error);
    }
  }
}

const step = (by) => open && showState(Math.min(Number(slider.max), Math.max(0, open.state + by))).catch(tellError);
byId("state-before").addEventListener("click", () => step(-1));
byId("state-next").addEventListener("click", () => step(1));
slider.addEventListener("input", () => step(Number(slider.value) - open.state));
