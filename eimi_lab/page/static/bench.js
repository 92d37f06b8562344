// The view of the bench: choose a run, run it dry, start, watch, pause, resume and end it. STOP is in the header.
import { ask, byId, el, facts, flagList, number, svg, tell } from "./dom.js";
import { on, state, steer } from "./live.js";
import { Picture } from "./picture.js";
import { plot } from "./plot.js";

const picture = new Picture(byId("live"));
let choicesShown = false;
let taken = { dataset: "", states: [], moduli: [] }; // stored states of the current run with their edges, and the moduli estimated from them
let asking = false;
let lastEdges = null;

const BEGINS = "starting the run …";
const tried = (act) => async (event) => {
  event?.preventDefault();
  try { await act(); } catch (error) { tell(error.message, true); }
};

export async function showBench() {
  if (choicesShown) return;
  choicesShown = true;
  const choices = await ask("/api/choices");
  for (const kind of ["protocol", "specimen", "rig"]) {
    byId(kind).replaceChildren(...choices[kind].map((name) => el("option", { value: name }, name)));
  }
  for (const [kind, name] of [["protocol", "dragon_skin_10_quick"], ["specimen", "type1"], ["rig", "virtual"]]) {
    const file = choices[kind].find((choice) => choice.includes(".")); // a shipped name has no dot
    byId(kind).value = file ?? name;
  }
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
const percent = (share) => share === null || share === undefined ? "not rated in the rig" : `${number(100 * share)} %`;
const PHASES = { beginning: "starting", running: "▶ running", pausing: "will pause after this state", paused: "❚❚ paused, coil off",
  stopping: "■ stopping", ended: "ended" };

let lastAbout = null;

function showState({ run, control }) {
  const goingOn = run !== null && run.phase !== "ended";
  const mine = control === "you";
  byId("order").hidden = goingOn;
  byId("under-way").hidden = !goingOn;
  for (const id of ["dry", "start"]) byId(id).disabled = !mine;
  byId("pause").disabled = !mine || run?.phase !== "running";
  byId("go-on").disabled = !mine || run?.phase !== "paused";
  byId("end").disabled = !mine || run?.phase === "stopping";
  if (!run) return;
  if (run.phase !== "beginning" && byId("told").textContent === BEGINS) tell("");
  if (!goingOn && lastAbout) {
    const off = run.coil === "off" ? { set_A: 0, on: false, field_mT: 0 } : {};
    showValues({ ...lastAbout, ...off, rate_Hz: 0 });
    picture.canvas.setAttribute("aria-label", "the last picture of the run");
  }
  byId("progress").max = run.states || 1;
  byId("progress").value = run.stored;
  facts(byId("progress-facts"), [
    ["run", PHASES[run.phase] + (run.phase === "ended" && run.status && run.last_words ? `: ${run.last_words}` : "")],
    ["dataset", run.dataset],
    ["protocol, specimen, rig", `${run.protocol}, ${run.specimen}, ${run.rig}`],
    ["states", `${run.stored} of ${run.states}`],
    ["time left", goingOn ? minutes(run.left_s) : "—"],
    ["largest heat of the coil", run.hottest_share === null ? "not rated in the rig" : `${percent(run.hottest_share)} of the continuous rating`],
    ["if the run fails", (run.guardian ? "a guardian process switches the coil off; if it is killed too, or the cable or the computer fails: " : "") + run.without_contact],
  ]);
  byId("said").replaceChildren(...run.said.slice().reverse().map((words) => el("li", {}, words)));
  followStates(run);
}

async function followStates(run) {
  if (taken.dataset !== run.dataset || run.stored < taken.states.length) taken = { dataset: run.dataset, states: [], moduli: [] };
  if (asking || taken.states.length >= run.stored) return;
  asking = true;
  const mine = taken;
  try {
    const about = await ask("/api/dataset", { file: run.dataset });
    for (let index = mine.states.length; index < about.states.length; index++) {
      const edges = await ask("/api/dataset/edges", { file: run.dataset, state: index });
      mine.states.push({ ...about.states[index], ...edges, flags: edges.flags });
      if (mine === taken) showPlot();
      const modulus = await ask("/api/dataset/modulus", { file: run.dataset, states: index + 1 });
      if (modulus) mine.moduli.push(modulus);
      if (mine === taken) showModulus();
    }
  } catch (error) { tell(error.message, true); }
  asking = false;
  if (state.run && taken.states.length < state.run.stored) setTimeout(() => followStates(state.run), 500);
}

function showPlot() {
  plot(byId("live-plot"), taken.states.map((one, index) => ({
    x: one.field_mT, y: one.tip_angle_deg, flagged: one.flags.length > 0, now: index === taken.states.length - 1,
    title: `state ${index}: ${number(one.field_mT)} mT, ${number(one.tip_angle_deg)}°`,
  })), { x: "field, mT", y: "tip angle, degrees", high: 230 });
}

function showModulus() {
  const last = taken.moduli[taken.moduli.length - 1];
  byId("modulus-plot").hidden = !last;
  if (!last) { byId("modulus-words").textContent = ""; return; }
  const [low, high] = last.interval_95_kPa;
  byId("modulus-words").textContent = `shear modulus so far: ${number(last.modulus_kPa)} kPa, 95 % between ${number(low)} and ${number(high)} `
    + `(${last.used} states; an estimate with a planar model, the result is that of the fit)`;
  plot(byId("modulus-plot"), taken.moduli.map((one) => ({
    x: one.states, y: one.modulus_kPa, low: one.interval_95_kPa[0], high: one.interval_95_kPa[1], now: one === last,
    title: `${one.states} states: ${number(one.modulus_kPa)} kPa`,
  })), { x: "states", y: "modulus, kPa", high: 180 });
}

on("state", showState);
on("frame", async (about, blob) => {
  await picture.show(blob, about.size_px, `live picture, frame ${about.number}`);
  byId("live").dataset.seen = about.seen;
  lastAbout = about;
  showValues(about);
  showLight(about);
});
on("edges", (edges) => {
  lastEdges = edges;
  picture.draw(edges);
  flagList(byId("live-flags"), edges.flags);
});

function showValues(about) {
  facts(byId("values"), [
    ["set current", `${number(about.set_A)} A`],
    ["measured current", about.on ? `${number(about.measured_A)} A` : "coil off"],
    ["field", `${number(about.field_mT)} mT`],
    ["heat of the coil", percent(about.heat_share)],
    ["frame rate", `${number(about.rate_Hz, 2)} Hz`],
    ["blur σ (focus)", lastEdges?.blur_px ? `${number(lastEdges.blur_px)} px (limit ${number(lastEdges.blur_limit_px)})` : "—"],
    ["tip angle", lastEdges?.tip_angle_deg !== undefined ? `${number(lastEdges.tip_angle_deg)}°` : "—"],
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
  byId("light-words").textContent = `exposure, dark to bright; saturated ${number(100 * saturated, 2)} % of the pixels${saturated > 0.001 ? " ▲ too bright" : ""}`;
}
