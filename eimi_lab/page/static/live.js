// The WebSocket to the server: it brings the state of the page, the newest frame, and whether this tab is in control.
import { byId, post, tell, tellError } from "./dom.js";
import { token } from "./token.js";

const listeners = { state: [], frame: [], edges: [] };
const REFUSED = 1008; // the close code of a socket without the token
const AGAIN_MS = [250, 500, 1000, 2000];
let socket = null, lost = 0, steered = false, stopping = false;
export let state = { run: null, control: "nobody", tab: "" };

export const on = (kind, act) => listeners[kind].push(act);
const give = (kind, ...what) => listeners[kind].forEach((act) => act(...what));
export const steer = (path, body) => post(path, body, state.tab);

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => say({ token });
  socket.onmessage = ({ data }) => {
    if (lost) tell("connected again; no state of a run was lost");
    lost = 0;
    if (typeof data === "string") heard(JSON.parse(data));
    else showFrame(data);
  };
  socket.onclose = ({ code }) => {
    state = { ...state, control: "nobody" };
    showHeader(true);
    if (code === REFUSED) { tell("open the address that `eimi dashboard` printed when it began", true); return; }
    if (!lost) tell("no connection to eimi dashboard; connecting again …", true);
    setTimeout(connect, AGAIN_MS[Math.min(lost++, AGAIN_MS.length - 1)]);
  };
}

function heard(message) {
  if (message.kind === "edges") return give("edges", message);
  state = message;
  if (message.control === "you") steered = true;
  else if (message.control === "other") steered = false;
  else if (steered) take(); // this tab was in control before the connection was lost
  sessionStorage.setItem("steered", steered ? "1" : "");
  showHeader(false);
  give("state", state);
}

function showFrame(data) {
  const length = new DataView(data).getUint32(0);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const blob = new Blob([new Uint8Array(data, 4 + length)], { type: "image/jpeg" });
  Promise.all(listeners.frame.map((act) => act(about, blob)))
    .catch(tellError)
    .finally(() => requestAnimationFrame(() => say({ shown: about.seen })));
  setTimeout(() => say({ shown: about.seen }), 200); // a tab in the background does not draw
}

const say = (message) => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };
const take = () => say({ take: true });

const HOW = { measured: "as measured", commanded: "commanded, not measured" };
const COIL = { off: "coil off", on: "COIL ON", "switching off": "switching off …", unknown: "COIL MAY BE ON" };

function showHeader(gone) {
  const coil = state.run?.coil ?? "off";
  byId("coil-words").textContent = gone ? "not connected" : COIL[coil];
  byId("coil-how").textContent = gone || coil !== "off" ? "" : HOW[state.run?.off_by] ?? "not measured";
  byId("coil").className = gone ? "gone" : coil.replace(" ", "-");
  byId("take").hidden = gone || state.control === "you";
  byId("control-words").textContent = gone ? "" : { you: "in control", other: "watching", nobody: "no tab in control" }[state.control];
}

async function stop() {
  if (stopping) return;
  stopping = true;
  tell("stopping: switching the coil off …");
  try {
    const { words, off } = await post("/api/stop");
    tell(words, !off);
  } catch (error) {
    tell(`STOP got no answer (${error.message}): switch the coil off at the supply`, true);
  }
  stopping = false;
}

byId("stop").addEventListener("click", stop);
addEventListener("keydown", (event) => { if (event.key === "Escape") stop(); });
byId("take").addEventListener("click", take);
steered = sessionStorage.getItem("steered") === "1";
connect();
