import { command, link, listen, silence, whenRefused } from "./link.js";
import * as panels from "./panels.js";
import * as plane from "./plane.js";
import { state, take } from "./state.js";
import * as stick from "./stick.js";

const $ = (id) => document.getElementById(id);
const NAMES = { map: ["map", "#3a4152"], hits: ["new hits", "#4a4f5c"], path: ["path", plane.COLOURS.estimate], scan: ["scan", plane.COLOURS.scan],
  prior: ["prior", plane.COLOURS.prior], truth: ["truth", plane.COLOURS.truth] };

plane.setUp($("plane"));
stick.setUp($("stick"), $("knob"));

for (const [name, [text, colour]] of Object.entries(NAMES)) {
  const button = document.createElement("button");
  button.textContent = text;
  button.style.setProperty("--c", colour);
  button.setAttribute("aria-pressed", "true");
  button.onclick = () => {
    plane.layers[name] = !plane.layers[name];
    button.setAttribute("aria-pressed", String(plane.layers[name]));
    plane.redraw();
  };
  $("layers").append(button);
}

$("nearer").onclick = () => plane.zoom(1.4);
$("farther").onclick = () => plane.zoom(1 / 1.4);
$("fit").onclick = () => { plane.fit(); plane.setFollow(false); };
$("follow").onclick = () => plane.setFollow(!plane.view.follow);
$("map").onchange = () => { plane.view.map = $("map").value; plane.redraw(); };
$("stop").onclick = () => command("stop");
$("rearm").onclick = () => command("rearm");
$("play").onclick = () => command(state.playback?.paused ? "resume" : "pause");
$("step").onclick = () => command("step", { type: stepType() });
$("rate").onchange = () => { command("rate", { rate: $("rate").value === "" ? null : Number($("rate").value) }); $("rate").blur(); };
$("seek").onchange = () => { command("seek", { place: Number($("seek").value) }); $("seek").blur(); };

function stepType() {
  return Object.keys(state.scans).length ? "scan" : Object.keys(state.images).length ? "image" : Object.keys(state.features).length ? "features" : "";
}

let quiet = 0;
whenRefused((name, text) => {
  $("refused").textContent = `${name}: ${text}`;
  $("refused").hidden = false;
  clearTimeout(quiet);
  quiet = setTimeout(() => { $("refused").hidden = true; }, 4000);
});

let shown = 0;
listen((look) => {
  take(look, plane.redraw);
  plane.redraw();
  if (performance.now() - shown > 180 || look.reset) { shown = performance.now(); panels.show(); }
});

setInterval(() => {
  const since = silence(), badge = $("link");
  const live = link.open && since < 2;
  badge.textContent = live ? "live" : since === Infinity ? "connecting" : `no news for ${Math.round(since)} s`;
  badge.className = `badge ${live ? "good" : "wait"}`;
  $("stick").classList.toggle("off", !live);
}, 500);

window.knotwork = { state, plane }; // for tests and the curious
