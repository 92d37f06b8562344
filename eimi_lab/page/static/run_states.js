// The stored states of the shown run: the tip angle of each state, and the modulus from the states so far.
import { ask, byId, decimals, number, withSigma } from "./dom.js";
import { state } from "./live.js";
import { plot } from "./plot.js";

const AGAIN_MS = 500;
const MODULI_SHARE = 0.2;
const nothingOf = ({ number, dataset }) => ({ number, dataset, states: [], edges: [], moduli: new Map(), nextModulusMs: 0 }); // moduli: by number of states
let taken = nothingOf({ number: 0, dataset: "" });
let reading = false;

// Show the states of this run only.
export function showStates(run) {
  if (taken.number !== run.number) {
    taken = nothingOf(run);
    showPlot();
    showModulus("");
  }
  if (run.stored && !reading) readStates();
}

async function readStates() {
  reading = true;
  while (state.run?.number === taken.number) {
    const mine = taken;
    try {
      if (await readNext(mine)) continue;
    } catch (error) {
      if (mine === taken) showModulus(error.message);
    }
    if (mine === taken && mine.states.length >= state.run.stored) break;
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
  reading = false;
}

// Read the next missing result: the edges of every state, the newest modulus, then the earlier moduli. Return whether a result was missing.
// While edges are missing, a modulus of the states with edges is read too, but the moduli take at most the share MODULI_SHARE of the time.
async function readNext(mine) {
  const { dataset: file, states, edges, moduli } = mine;
  if (states.length < state.run.stored) mine.states = (await ask("/api/dataset", { file })).states;
  const many = mine.states.length, edgesMissing = edges.length < many;
  if (edgesMissing && (!edges.length || moduli.has(edges.length) || performance.now() < mine.nextModulusMs)) {
    edges.push(await ask("/api/dataset/edges", { file, state: edges.length }));
    if (mine === taken) showPlot();
    return true;
  }
  for (let first = edges.length; first > 0; first--) {
    if (moduli.has(first)) continue;
    moduli.set(first, null); // asked for only once, also if there is no modulus
    const beganMs = performance.now();
    try {
      moduli.set(first, await ask("/api/dataset/modulus", { file, states: first }));
    } finally {
      const endedMs = performance.now();
      mine.nextModulusMs = endedMs + (endedMs - beganMs) * (1 / MODULI_SHARE - 1);
    }
    if (mine === taken) showModulus("");
    return true;
  }
  return false;
}

function showPlot() {
  const { states, edges } = taken;
  byId("live-plot").hidden = !edges.length;
  plot(byId("live-plot"), edges.map((found, index) => ({
    x: states[index].field_mT, y: found.tip_angle_deg, flagged: states[index].flags.length + found.flags.length > 0, now: index === edges.length - 1,
    title: `state ${index}: ${number(states[index].field_mT)} mT, ${withSigma(found.tip_angle_deg, found.tip_angle_sigma_deg, "°")}`,
  })), { x: "field, mT", y: "tip angle, degrees", high: 230 });
}

function showModulus(why) {
  const all = [...taken.moduli].sort(([a], [b]) => a - b).map(([, one]) => one).filter((one) => one);
  const last = all[all.length - 1];
  byId("modulus-plot").hidden = all.length < 2;
  byId("modulus").hidden = !last && !why;
  byId("modulus-words").textContent = why;
  if (!last) { for (const id of ["modulus-number", "modulus-interval"]) byId(id).textContent = ""; return; }
  const [low, high] = last.interval_95_kPa, digits = decimals((high - low) / 3.92); // of a normal distribution
  byId("modulus-number").textContent = `${last.modulus_kPa.toFixed(digits)} kPa`;
  byId("modulus-interval").textContent = `95 %: ${low.toFixed(digits)} to ${high.toFixed(digits)} kPa`;
  byId("modulus-words").textContent = why || `Shear modulus so far, from ${last.used} states of ${taken.dataset}. Largest source of its uncertainty: ${last.limited_by}. `
    + "This is a quick estimate for a Neo-Hookean beam. A fit gives the final result.";
  plot(byId("modulus-plot"), all.map((one) => ({
    x: one.states, y: one.modulus_kPa, low: one.interval_95_kPa[0], high: one.interval_95_kPa[1], now: one === last,
    title: `${one.states} states: ${number(one.modulus_kPa)} kPa`,
  })), { x: "states", y: "modulus, kPa", high: 180, whole: true });
}
