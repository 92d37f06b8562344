// The fit of the open dataset: start the fit, show its progress and its result.
import { ask, byId, el, number, tellError, tried } from "./dom.js";
import { on, state, steer } from "./live.js";
import { plot } from "./plot.js";

let file = "", stored = null, asked = 0, shown = ""; // stored: null until the server has answered; shown: number and phase of the fit on the screen

export async function showFits(dataset) {
  const request = ++asked;
  if (file !== dataset) {
    file = dataset;
    stored = null;
    byId("fit-result").replaceChildren();
    forgetPlot();
    byId("fit-report").hidden = true;
    shown = stageOf(state.fit);
    showProgress();
  }
  const { fits, report } = await ask("/api/fit", { file });
  if (request !== asked) return;
  stored = fits;
  byId("fit-start").textContent = fits.length ? "Fit again and replace this fit" : "Fit";
  byId("fit-report").hidden = !report;
  if (report) byId("fit-report").href = report;
  byId("fit-result").replaceChildren(...fits.flatMap(result));
  if (fits.length) converge(fits[0].generations);
  else forgetPlot();
  showProgress();
}

function result(fit) {
  const budget = fit.budget.map(([source, percent]) => el("li", {}, `${source}: ${number(percent, 2)} %`));
  return [
    el("p", {}, el("strong", {}, fit.summary)),
    ...fit.notes.map((words) => el("p", { class: "small" }, words)),
    ...fit.doubts.map((words) => el("p", { class: "warn" }, `▲ doubt: ${words}`)),
    el("h3", {}, "What makes the modulus uncertain"),
    budget.length ? el("ul", {}, ...budget) : el("p", { class: "small" }, "only noise, because no other uncertainty is given"),
  ];
}

function forgetPlot() {
  byId("fit-plot").replaceChildren();
  byId("fit-plot-words").hidden = true;
}

function converge(generations) {
  byId("fit-plot-words").hidden = false;
  plot(byId("fit-plot"), generations.map(([generation, best]) => ({ x: generation, y: 1e3 * best, title: `${number(1e3 * best)} µm` })),
    { x: "generation of the search", y: "smallest error, µm", small: true, whole: true });
}

const stageOf = (fit) => fit && fit.dataset === file ? `${fit.number} ${fit.phase}` : "";

function showProgress() {
  const { fit = null, control } = state;
  const mine = fit !== null && fit.dataset === file;
  const going = fit !== null && (fit.phase === "fitting" || fit.phase === "reporting");
  byId("fit-start").disabled = control !== "you" || going || stored === null;
  byId("fit-end").hidden = !going || !mine;
  byId("fit-end").disabled = control !== "you";
  byId("fit-words").className = mine && fit.phase === "failed" ? "bad" : "";
  if (!mine) { byId("fit-words").textContent = going ? `another dataset is being fitted: ${fit.dataset}` : ""; return; }
  const last = fit.generations[fit.generations.length - 1];
  const words = { fitting: last ? `${fit.model}: generation ${last[0]}, error ${number(1e3 * last[1])} µm` : `${fit.model}: ${fit.last_words || "starting …"}`,
    reporting: "writing the report …", done: `${fit.model}: done`, failed: `the fit failed: ${fit.last_words}` };
  byId("fit-words").textContent = words[fit.phase];
  if (going && fit.generations.length) converge(fit.generations);
}

on("state", ({ fit }) => {
  showProgress();
  if (stageOf(fit) === shown) return;
  shown = stageOf(fit);
  if (shown && fit.phase !== "fitting") showFits(file).catch(tellError);
});

byId("fit").addEventListener("submit", tried(() => steer("/api/fit/start", { dataset: file, model: byId("law").value, replace: stored.length > 0 })));
byId("fit-end").addEventListener("click", tried(() => steer("/api/fit/end")));
