// The result of an ended run: why it failed, and the next steps, which are the fit and the report.
import { ask, byId, tellError, tried } from "./dom.js";
import { on, state } from "./live.js";
import { openRun } from "./runs.js";

let shown = "", answered = null; // answered: number of the run whose fits and report the page knows

export function showOutcome(run) {
  const ended = run !== null && run.phase === "ended";
  const incomplete = ended && run.status !== 0;
  const stopped = incomplete && run.stopped && run.coil === "off"; // on request, and with the coil off
  byId("outcome").hidden = !ended;
  byId("outcome").className = stopped ? "stopped" : incomplete ? "failed" : "";
  if (!ended) { shown = ""; return; }
  const stored = run.stored ? `${run.stored} of ${run.states} states are stored in ${run.dataset}.` : "No state was stored.";
  byId("outcome-title").textContent = stopped ? "The run was stopped" : incomplete ? "The run did not complete" : "The run is complete";
  byId("outcome-words").textContent = incomplete && run.last_words ? run.last_words : stored;
  byId("outcome-stored").textContent = incomplete && run.last_words && !run.last_words.includes(" states are in ") ? stored : "";
  byId("fit-this").hidden = !run.stored || answered !== run.number; // before, a click would not start a fit
  const stage = `${run.number} ${state.fit?.number} ${state.fit?.phase}`;
  if (run.stored && stage !== shown) {
    shown = stage;
    showReport(run).catch(tellError).finally(() => {
      if (state.run?.number !== run.number) return;
      answered = run.number;
      byId("fit-this").hidden = false;
    });
  }
}

async function showReport(run) {
  const { fits, report } = await ask("/api/fit", { file: run.dataset });
  if (state.run?.number !== run.number) return;
  byId("outcome-report").hidden = !report;
  if (report) byId("outcome-report").href = report;
  byId("fit-this").textContent = fits.length ? "Show the fit" : "Fit this";
  byId("fit-this").dataset.fit = fits.length ? "" : "1";
}

byId("fit-this").addEventListener("click", tried(async () => {
  const { run } = state, fits = byId("fit-this").dataset.fit;
  location.hash = "#runs";
  await openRun(run.dataset);
  byId("fit").scrollIntoView();
  if (fits && !byId("fit-start").disabled) byId("fit").requestSubmit();
}));
on("state", ({ run }) => showOutcome(run));
