// The view "Bench": choose the files of a run, list its steps (dry run), and control the run. STOP is in the header.
import { ask, askPicture, byId, el, facts, flagList, number, svg, tell, tellError, tried, withSigma } from "./dom.js";
import { on, state, steer } from "./live.js";
import { Picture } from "./picture.js";
import { showStates } from "./run_states.js";
import { Stillness } from "./stillness.js";

const picture = new Picture(byId("live")), stillness = new Stillness();
let choicesShown = false;
let lastRun = 0, shownRun = 0; // number of the last run, and number of the run whose picture and values are shown; 0 is the live camera
let lastAbout = null, lastEdges = null;
let storedOf = 0; // number of the ended run whose last state was read from its dataset

const BEGINS = "starting the run …";

export async function showBench() {
  if (choicesShown) return;
  choicesShown = true;
  const choices = await ask("/api/choices");
  for (const kind of ["protocol", "specimen", "rig"]) {
    byId(kind).replaceChildren(...choices[kind].map((name) =>
      el("option", { value: name }, choices.incomplete.includes(name) ? `${name} (not complete)` : name)));
  }
  for (const [kind, name] of [["protocol", "dragon_skin_10_quick"], ["specimen", "type1"], ["rig", "virtual"]]) {
    const file = choices[kind].find((choice) => choice.includes(".") && !choices.incomplete.includes(choice)); // a shipped name has no dot
    byId(kind).value = file ?? name;
  }
  showState(state);
}

function order() {
  const form = new FormData(byId("order"));
  return { ...Object.fromEntries(form), resume: form.has("resume") };
}

byId("dry").addEventListener("click", tried(async () => {
  tell("computing the dry run …");
  const { lines } = await steer("/api/run/dry", order());
  byId("dry-lines").textContent = lines.join("\n");
  byId("dry-lines").hidden = false;
  tell(lines[lines.length - 1]);
}));
byId("order").addEventListener("submit", tried(async () => {
  byId("dry-lines").hidden = true;
  tell(BEGINS);
  await steer("/api/run/start", order());
}));
for (const act of ["pause", "go-on", "end"]) byId(act).addEventListener("click", tried(() => steer(`/api/run/${act}`)));

const minutes = (seconds) => seconds === null ? "—" : seconds < 90 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
const percent = (share) => share === null || share === undefined ? "no rating" : `${number(100 * share)} %`;
const PHASES = { beginning: "starting", running: "▶ running", pausing: "will pause after this state", paused: "❚❚ paused, coil off",
  ending: "ending with a ramp down", stopping: "■ stopping", ended: "ended" };

function showState({ run, control, camera = null }) {
  const goingOn = run !== null && run.phase !== "ended";
  const mine = control === "you";
  byId("order").hidden = goingOn;
  byId("under-way").hidden = !goingOn;
  for (const id of ["dry", "start"]) byId(id).disabled = !mine;
  byId("pause").disabled = !mine || run?.phase !== "running";
  byId("go-on").disabled = !mine || run?.phase !== "paused";
  byId("end").disabled = !mine || ["ending", "stopping"].includes(run?.phase);
  byId("camera").disabled = !mine || goingOn;
  showCameraWords();
  if (mine && run === null && camera === null && byId("rig").value.includes(".")) showCamera(); // a shipped rig, without a dot, is shown on request
  byId("bench").classList.toggle("with-run", run !== null);
  if (!run) return;
  if (run.number !== lastRun) forget(lastRun = run.number);
  if (run.phase !== "beginning" && byId("told").textContent === BEGINS) tell("");
  if (lastAbout && shownRun === run.number) showValues(lastAbout);
  if (!goingOn && lastAbout && shownRun === run.number) picture.canvas.setAttribute("aria-label", "the last picture of the run");
  if (!goingOn && !lastAbout && run.stored && shownRun === run.number) showStored(run).catch(tellError);
  byId("progress").max = run.states || 1;
  byId("progress").value = run.stored;
  facts(byId("progress-facts"), [
    ["run", PHASES[run.phase]],
    ["dataset", run.dataset],
    ["protocol, specimen, rig", `${run.protocol}, ${run.specimen}, ${run.rig}`],
    ["states", run.states ? `${run.stored} of ${run.states}` : "—"],
    ["time left", goingOn ? minutes(run.left_s) : "—"],
    ["largest heat of the coil", !run.states ? "—" : run.hottest_share === null ? "no rating in the rig file" : `${percent(run.hottest_share)} of the allowed heat`],
    ["if the run fails", !run.states ? "—" : (run.guardian ? "a guardian process switches the coil off; if the guardian is killed too, or the cable or the computer fails: " : "") + run.without_contact],
  ]);
  byId("said").replaceChildren(...run.said.slice().reverse().map((words) => el("li", {}, words)));
  showStates(run);
}

function showCameraWords() {
  const { camera = null, run } = state;
  const live = shownRun === 0 && lastAbout !== null;
  byId("camera-words").textContent = camera?.open ? (live ? `live camera of ${camera.rig}, without a run` : `opening the camera of ${camera.rig} …`)
    : camera?.last_words && run?.phase !== "running" ? `no live picture: ${camera.last_words}`
    : storedOf && storedOf === shownRun && !lastAbout ? `the last state of ${run.dataset}`
    : run === null ? "“Live camera” shows the picture of the chosen rig. “Start” begins a run." : "";
}

// Show the last state of an ended run of which this tab received no frame, as after a reload.
async function showStored({ number: run, dataset: file, stored }) {
  if (storedOf === run) return;
  storedOf = run;
  const at = { file, state: stored - 1 };
  const [blob, edges] = await Promise.all([askPicture("/api/dataset/picture", at), ask("/api/dataset/edges", at)]);
  if (shownRun !== run || lastAbout) return;
  if (await picture.show(blob, null, `state ${at.state} of ${file}`)) picture.draw(edges);
  showCameraWords();
}

// Show the camera of the chosen rig, to place the beam and to set focus and exposure.
let cameraAsked = "";
function showCamera() {
  const { rig, specimen } = order();
  if (cameraAsked === `${rig} ${specimen}`) return;
  cameraAsked = `${rig} ${specimen}`;
  forget(0);
  steer("/api/camera", { rig, specimen }).catch((error) => { byId("camera-words").textContent = `no live picture: ${error.message}`; });
}
byId("camera").addEventListener("click", () => { cameraAsked = ""; showCamera(); });
for (const kind of ["rig", "specimen"]) byId(kind).addEventListener("change", () => { if (state.run === null && byId("rig").value.includes(".")) showCamera(); });

// Clear the picture, edges, flags and values of the previous run.
function forget(number) {
  shownRun = number;
  lastAbout = lastEdges = null;
  picture.clear();
  stillness.forget();
  for (const id of ["values", "light", "live-flags"]) byId(id).replaceChildren();
  byId("light-words").textContent = "";
}

on("state", showState);
on("frame", async (about, blob) => {
  if (about.run !== shownRun || !await picture.show(blob, about.size_px, `live picture, frame ${about.number}`)) return;
  stillness.see(picture.canvas, about.seen);
  drawEdges();
  byId("live").dataset.seen = about.seen;
  lastAbout = about;
  showCameraWords();
  showValues(about);
  showLight(about);
});
on("edges", (edges) => {
  if (edges.run !== shownRun) return;
  lastEdges = edges;
  if (lastAbout) drawEdges(); // without a frame of the run, the picture is the stored state, which keeps its own edges
  flagList(byId("live-flags"), edges.flags);
});

// Edges are found more slowly than frames arrive. Edges are drawn only on a frame that looks like theirs.
function drawEdges() {
  picture.draw(lastEdges && stillness.holds(lastEdges.seen) ? lastEdges : null);
}

// The set current, measured current and field, consistent with the state of the coil in the header. A frame can be older than this state.
function currents(about) {
  if (about.run === 0) return ["—", "—", "—"];
  const { coil, coil_A, off_by } = state.run;
  const measured = coil_A === null ? null : `${number(coil_A)} A`;
  switch (coil) {
    case "on": return [`${number(about.set_A)} A`, `${number(about.measured_A)} A`, `${number(about.field_mT)} mT`];
    case "switching off": return ["0 A", "not confirmed yet", "—"];
    case "unknown": return ["0 A", measured ?? "not known", "—"];
    default: return ["0 A", measured ?? (off_by === "measured" ? "0 A" : "not measured"), "0 mT"];
  }
}

function showValues(about) {
  const [set, measured, field] = currents(about), ended = about.run !== 0 && state.run.phase === "ended"; // the last frame may arrive after the end
  facts(byId("values"), [
    ["set current", set],
    ["measured current", measured],
    ["field", field],
    ["heat of the coil", about.run === 0 ? "—" : percent(about.heat_share)],
    ["frame rate", `${number(ended ? 0 : about.rate_Hz, 2)} Hz`],
    ["blur σ (focus)", lastEdges?.blur_px ? `${number(lastEdges.blur_px)} px (limit ${number(lastEdges.blur_limit_px)})` : "—"],
    ["tip angle", lastEdges ? withSigma(lastEdges.tip_angle_deg, lastEdges.tip_angle_sigma_deg, "°") : "—"],
  ]);
}

function showLight({ histogram, saturated_share: saturated }) {
  const most = Math.max(...histogram, 1e-6), wide = 480, high = 80, step = wide / histogram.length;
  const frame = svg("svg", { class: "plot low", viewBox: `0 0 ${wide} ${high}`, preserveAspectRatio: "none", role: "img", "aria-label": "exposure, dark to bright" });
  histogram.forEach((share, bin) => {
    const tall = share > 0 ? Math.max(1.5, high * Math.sqrt(share / most)) : 0;
    frame.append(svg("rect", { class: bin === histogram.length - 1 && saturated > 0 ? "column full" : "column", x: bin * step, width: step - 1, y: high - tall, height: tall }));
  });
  byId("light").replaceChildren(frame);
  byId("light-words").textContent = `exposure, dark to bright; ${number(100 * saturated, 2)} % of the pixels are saturated${saturated > 0.001 ? " ▲ too bright" : ""}`;
}
