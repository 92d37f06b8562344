// The view "Weights and a phone": photographs, clicks and typed numbers give the shear modulus of the beam.
import { Clicks } from "./clicks.js";
import { address, ask, askPicture, byId, el, flagList, number, post, send } from "./dom.js";
import { on, state, steer } from "./live.js";
import { Picture } from "./picture.js";
import { openRun } from "./runs.js";

const WAIT_MS = 250, MOST_ALONG = 5;
const CLAMP = { one: ["middle of the line where the beam leaves its clamp"], two: ["one end of the clamp's edge at which the beam leaves the clamp", "the other end of the clamp's edge"] };
const THEN = ["middle of the tip", "first tick of the ruler", "second tick of the ruler"];
const picture = new Picture(byId("phone-picture"));
const clicks = new Clicks(picture, names, changed);
let folder = null; // { name, pictures, size_px, lens, written, dataset }
let shown = "", asked = 0, waiting = null, saved = null, fitted = ""; // saved: { dataset }; fitted: number and phase of the fit on the screen

const edge = () => byId("phone-plumb").value === "clamp" || byId("phone-leaves").value === "clamp";
const needed = () => [...(edge() ? CLAMP.two : CLAMP.one), ...THEN];
function names() { return [...needed(), ...Array.from({ length: MOST_ALONG }, (_, index) => `point ${index + 1} along the beam`)]; }

// A failure is written beside the button or the field that it concerns.
function words(text, bad = false) {
  byId("phone-words").textContent = text;
  byId("phone-words").className = bad ? "bad" : "";
  for (const old of byId("phone-form").querySelectorAll(".field-error")) old.remove();
  for (const field of byId("phone-form").querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
  if (!bad) return null;
  const fields = [...byId("phone-form").querySelectorAll("[data-key]")].sort((a, b) => b.dataset.key.length - a.dataset.key.length);
  const field = fields.find(({ dataset }) => new RegExp(`(^|[^\\w])${dataset.key.replaceAll(".", "\\.")}($|[^\\w])`).test(text));
  if (field) {
    field.setAttribute("aria-invalid", "true");
    field.after(el("small", { class: "bad field-error", role: "alert" }, text));
  }
  return field ?? null;
}

const tried = (act) => async (event) => {
  event?.preventDefault();
  try { await act(event); } catch (error) { (words(error.message, true) ?? byId("phone-words")).scrollIntoView({ block: "nearest" }); }
};

let ready = null; // promise that the first folder has been read
export function showPhone() {
  ready ??= begin().catch((error) => { ready = null; throw error; });
  return ready;
}

async function begin() {
  const folders = await ask("/api/pictures/folders");
  const all = [...new Set(["", ...folders.map((name) => name === "." ? "" : name)])]; // "." is the folder of the page
  byId("phone-folder").replaceChildren(...all.map((name) => el("option", { value: name }, name || "(this folder)")));
  if (!folders.includes(".") && folders.length) byId("phone-folder").value = folders[0];
  await openFolder();
}

async function openFolder() {
  const name = byId("phone-folder").value;
  asked += 1;
  shown = ""; // a picture of the previous folder that arrives late is not shown
  byId("phone-next").textContent = "opening the folder …";
  const opened = await ask("/api/phone", { folder: name });
  if (byId("phone-folder").value !== name) return;
  if (folder) { // what was typed for the previous folder does not go into this one
    byId("phone-list").replaceChildren();
    for (const field of byId("phone-form").querySelectorAll("[data-key]")) field.value = field.defaultValue;
  }
  folder = { name, ...opened };
  saved = null;
  byId("phone-replace-row").hidden = !folder.written.length;
  for (const field of byId("phone-form").querySelectorAll("[data-key]")) if (folder.beam[field.dataset.key]) field.value = folder.beam[field.dataset.key];
  showLens();
  listPictures();
  byId("phone-result").hidden = true;
  if (folder.pictures.length) await showPicture(folder.pictures[0], true);
  else { picture.clear(); clicks.begin(null); next(); }
}

function showLens() {
  byId("phone-lens").textContent = folder.lens ? `The distance from the lens to the beam is computed from the ${folder.lens}.` : folder.pictures.length ? "The file of the first picture does not contain the focal length. Type the distance from the lens to the beam." : "";
  byId("phone-stand-off").hidden = !folder.pictures.length || Boolean(folder.lens);
}

function listPictures() {
  const typed = grams();
  byId("phone-list").replaceChildren(...folder.pictures.map((name) => el("p", {},
    el("button", { type: "button", onclick: tried(() => showPicture(name)), "aria-current": String(name === shown) }, name),
    el("input", { name, inputmode: "decimal", "data-key": name, "aria-label": `grams of ${name}`, placeholder: "g", value: typed[name] ?? folder.grams[name] ?? "" }))));
}

const grams = () => Object.fromEntries([...byId("phone-list").querySelectorAll("input")].filter((input) => input.value.trim()).map((input) => [input.name, input.value]));

async function showPicture(name, fresh = false) {
  shown = name;
  for (const button of byId("phone-list").querySelectorAll("button")) button.setAttribute("aria-current", String(button.textContent === name));
  picture.draw(null);
  const of = folder, blob = await askPicture("/api/phone/picture", { folder: of.name, picture: name });
  if (shown !== name || folder !== of) return;
  await picture.show(blob, of.size_px, name);
  if (shown !== name || folder !== of) return; // another one was chosen
  clicks.begin(of.size_px, fresh ? [] : clicks.points);
  next();
  later(0);
}

async function receive(files) {
  words("receiving …");
  await showPhone(); // a person may drop pictures before the folder has been read
  if (folder?.name !== byId("phone-folder").value) await openFolder(); // or before another folder has been read
  let done = 0, failed = "";
  for (const file of files) {
    words(`receiving ${file.name}, ${done + 1} of ${files.length} …`);
    try { await send(address("/api/phone/receive", { folder: folder.name, name: file.name }), file, state.tab); done += 1; } catch (error) { failed = error.message; }
  }
  const typed = grams(), points = clicks.points;
  folder = { ...folder, ...await ask("/api/phone", { folder: folder.name }), grams: { ...folder.grams, ...typed } };
  showLens();
  listPictures();
  if (folder.pictures.length) { await showPicture(folder.pictures.includes(shown) ? shown : folder.pictures[0]); if (points.length) clicks.begin(folder.size_px, points); }
  words(failed || `${done} ${done === 1 ? "picture is" : "pictures are"} in the folder`, Boolean(failed));
  next();
}

function next() {
  const [count, all] = [clicks.points.length, needed()];
  byId("phone-next").textContent = !folder?.pictures.length ? "Drop the pictures first."
    : count < all.length ? `Click ${count + 1} of ${all.length}: ${all[count]}.`
    : "All points are set. Drag a point to correct its position. If the edges are wrong, click up to five more points along the beam, from the clamp to the tip.";
  byId("phone-undo").disabled = byId("phone-clear").disabled = !count;
  byId("phone-redo").disabled = !clicks.undone.length;
}

function changed() { next(); later(); }

function clicked() {
  const points = [...clicks.points], clamp = points.splice(0, edge() ? 2 : 1), [tip, first, second, ...along] = points;
  const all = { clamp_px: clamp, tip_px: tip, ruler_px: [first, second], ruler_mm: byId("ruler-between").value, plumb: byId("phone-plumb").value, leaves: byId("phone-leaves").value };
  if (along.length) all.along_px = along;
  if (!byId("phone-stand-off").hidden) all.stand_off_mm = byId("stand-off").value;
  return all;
}

const beam = () => Object.fromEntries([...byId("phone-form").querySelectorAll("[data-key]")].map((field) => [field.dataset.key, field.value]));
const complete = () => clicks.points.length >= needed().length && [...byId("phone-form").querySelectorAll("[required]")].every((field) => field.value.trim() || field.closest("[hidden]"));

function later(wait = WAIT_MS) {
  clearTimeout(waiting);
  waiting = setTimeout(() => findEdges().catch((error) => words(error.message, true)), wait);
}

async function findEdges() {
  const mine = ++asked;
  picture.draw(null);
  if (!shown || !complete()) return;
  words("looking for the edges …");
  try {
    const edges = await post("/api/phone/edges", { folder: folder.name, picture: shown, clicks: clicked(), beam: beam() });
    if (mine !== asked) return;
    picture.draw(edges);
    const points = edges.left.length + edges.right.length;
    byId("phone-picture").dataset.points = points;
    words(points ? `edges found in ${shown}: ${points} points` : `no edges found in ${shown}; the flag below gives the reason`, !points);
    flagList(byId("phone-flags"), edges.flags.filter((flag) => flag.severity !== "note"));
    byId("phone-sources").replaceChildren(...edges.sources.map(([key, value, source]) => el("li", {}, el("strong", {}, `${key} = ${value}`), `: ${source}`)));
  } catch (error) {
    if (mine === asked) words(error.message, true);
  }
}

async function saveAndFit() {
  const missing = [...byId("phone-form").querySelectorAll("[required]")].find((field) => !field.value.trim() && !field.closest("[hidden]"));
  if (missing) { missing.focus(); throw new Error(`${missing.dataset.key} is missing`); }
  if (clicks.points.length < needed().length) throw new Error(`click this point on the picture: ${needed()[clicks.points.length]}`);
  words("writing the files and the dataset …");
  byId("phone-result").hidden = true;
  const replace = byId("phone-replace").checked || Boolean(saved);
  try {
    saved = await steer("/api/phone/save", { folder: folder.name, clicks: clicked(), beam: beam(), grams: grams(), replace });
  } catch (error) {
    byId("phone-replace-row").hidden = false; // the folder may contain files that it did not contain when it was opened
    throw error;
  }
  words(`wrote ${saved.written.join(", ")} and ${saved.dataset}: ${saved.states} states; the fit begins …`);
  await steer("/api/fit/start", { dataset: saved.dataset, model: "neo-hookean", free: saved.free, replace: true });
}

on("state", ({ fit }) => {
  if (!saved || !fit || fit.dataset !== saved.dataset) return;
  if (fit.phase === "failed") words(`the fit failed: ${fit.last_words}`, true);
  else if (fit.phase !== "done") words(fit.phase === "reporting" ? "writing the report …" : `fitting: ${fit.last_words || "starting …"}`);
  const stage = `${fit.number} ${fit.phase}`;
  if (stage === fitted) return;
  fitted = stage;
  if (fit.phase === "done" || fit.phase === "reporting") showResult().catch((error) => words(error.message, true));
});

async function showResult() {
  const { fits, report } = await ask("/api/fit", { file: saved.dataset });
  if (!fits.length) return;
  const [fit] = fits, [value, , low, high] = fit.modulus;
  byId("phone-result").hidden = false;
  byId("phone-modulus").textContent = `${number(value / 1e3, 4)} kPa`;
  byId("phone-interval").textContent = low === null ? "" : `95 % between ${number(low / 1e3, 4)} and ${number(high / 1e3, 4)} kPa (initial shear modulus)`;
  byId("phone-budget").replaceChildren(...fit.budget.map(([source, percent]) => el("li", {}, `${source}: ${number(percent, 2)} %`)));
  byId("phone-doubts").replaceChildren(...fit.doubts.map((doubt) => el("li", { class: "warn" }, `▲ doubt: ${doubt}`)), ...fit.notes.map((note) => el("li", {}, note)));
  byId("phone-report").hidden = !report;
  if (report) { byId("phone-report").href = report; words("done"); }
  byId("phone-result").scrollIntoView({ block: "nearest" });
}

byId("phone-folder").addEventListener("change", tried(openFolder));
byId("phone-files").addEventListener("change", tried(async ({ target }) => { await receive([...target.files]); target.value = ""; }));
byId("phone").addEventListener("dragover", (event) => { event.preventDefault(); byId("phone-drop").classList.add("over"); });
byId("phone").addEventListener("dragleave", () => byId("phone-drop").classList.remove("over"));
byId("phone").addEventListener("drop", tried((event) => { byId("phone-drop").classList.remove("over"); return receive([...event.dataTransfer.files]); }));
byId("phone-undo").addEventListener("click", () => clicks.undo());
byId("phone-redo").addEventListener("click", () => clicks.redo());
byId("phone-clear").addEventListener("click", () => clicks.clear());
for (const id of ["phone-plumb", "phone-leaves"]) byId(id).addEventListener("change", () => { const two = edge(); if (two !== (byId("phone").dataset.edge === "1")) clicks.begin(clicks.size); byId("phone").dataset.edge = two ? "1" : ""; changed(); });
byId("phone-form").addEventListener("input", ({ target }) => { if (target.dataset.key && !target.closest("#phone-list")) later(); });
byId("phone-form").addEventListener("submit", tried(saveAndFit));
byId("phone-states").addEventListener("click", tried(async () => { location.hash = "#runs"; await openRun(saved.dataset); }));
