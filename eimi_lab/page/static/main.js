// Shows the view whose name stands after # in the address.
import { showBench } from "./bench.js";
import { byId, tellError } from "./dom.js";
import "./outcome.js";
import { showPhone } from "./phone.js";
import { showPictures } from "./pictures.js";
import { showFolder } from "./runs.js";

const VIEWS = { bench: showBench, runs: showFolder, pictures: showPictures, phone: showPhone };

function show() {
  const asked = location.hash.slice(1);
  const view = asked in VIEWS ? asked : Object.keys(VIEWS)[0];
  for (const name of Object.keys(VIEWS)) byId(name).hidden = name !== view;
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#${view}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  Promise.resolve(VIEWS[view]()).catch(tellError);
}

addEventListener("hashchange", show);
show();
