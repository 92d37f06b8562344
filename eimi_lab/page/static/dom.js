// Elements of the page, and requests to the server. Text from a file is never read as HTML.

import { token } from "./token.js";

export const byId = (id) => document.getElementById(id);

export function el(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

export function tell(words, bad = false) {
  const told = byId("told");
  told.textContent = words;
  told.classList.toggle("bad", bad);
}

export const tellError = (error) => tell(error.message, true);
export const tried = (act) => async (event) => {
  event?.preventDefault();
  try { await act(event); } catch (error) { tellError(error); }
};

export function facts(list, pairs) {
  list.replaceChildren(...pairs.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, String(value ?? "—"))]));
}

export function flagList(list, flags) {
  list.replaceChildren(...flags.map((flag) => el("li", { class: flag.severity },
    el("strong", {}, `${flag.name} (${flag.severity})`),
    ` ${number(flag.value)}, limit ${number(flag.limit)}: ${flag.remedy}`)));
}

export const number = (value, digits = 3) =>
  value === null || value === undefined ? "—" : String(Number(Number(value).toPrecision(digits)));

// Return how many decimals a value with this standard uncertainty deserves: the uncertainty keeps one or two digits.
export const decimals = (sigma) => sigma > 0 ? Math.min(20, Math.max(0, -Math.floor(Math.log10(sigma / 2)))) : 3;

// Return a value with its standard uncertainty as text. The uncertainty determines the number of digits.
export function withSigma(value, sigma, unit) {
  if (!sigma || value === null) return value === null ? "—" : `${number(value)}${unit}`;
  const digits = decimals(sigma);
  return `${(Math.round(value * 10 ** digits) / 10 ** digits + 0).toFixed(digits)} ± ${sigma.toFixed(digits)}${unit}`;
}

export function address(path, parameters = {}) {
  const query = new URLSearchParams(parameters).toString();
  return query ? `${path}?${query}` : path;
}

async function answer(path, request = {}) {
  const response = await fetch(path, { ...request, headers: { ...request.headers, "X-Eimi-Token": token } });
  if (response.ok) return response;
  const text = await response.text();
  let words = text;
  try { words = JSON.parse(text).error; } catch { /* the answer is plain text */ }
  throw new Error(words || `the page answered ${response.status}`);
}

export async function ask(path, parameters) {
  return (await answer(address(path, parameters))).json();
}

export async function post(path, body = {}, tab = "") {
  const headers = { "Content-Type": "application/json", "X-Tab": tab };
  return (await answer(path, { method: "POST", headers, body: JSON.stringify(body) })).json();
}

// Send a file as the body of a request.
export async function send(path, file, tab) {
  return (await answer(path, { method: "POST", headers: { "Content-Type": "application/octet-stream", "X-Tab": tab }, body: file })).json();
}

export async function askPicture(path, parameters) {
  return (await answer(address(path, parameters))).blob();
}
