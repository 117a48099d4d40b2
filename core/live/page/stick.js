// The stick: sent ten times a second while it is held, and once when it is let go.
import { command, link, silence } from "./link.js";

const PERIOD = 100; // ms
const who = Array.from(crypto.getRandomValues(new Uint32Array(2)), (n) => n.toString(36)).join("");
let held = null, where = [0, 0], busy = false, timer = 0;

async function send(last = false) {
  if (busy && !last) return;
  busy = true;
  const [forward, left] = where;
  await command("stick", { who, forward, left, tick: link.tick });
  busy = false;
}

export function setUp(pad, knob) {
  const place = (event) => {
    const box = pad.getBoundingClientRect(), reach = box.width / 2 - 20;
    let x = (event.clientX - box.left - box.width / 2) / reach, y = (event.clientY - box.top - box.height / 2) / reach;
    const far = Math.hypot(x, y);
    if (far > 1) { x /= far; y /= far; }
    if (Math.hypot(x, y) < 0.08) x = y = 0;
    where = [+(-y).toFixed(3), +(-x).toFixed(3)];
    knob.style.transform = `translate(${x * reach}px, ${y * reach}px)`;
  };
  const release = (event) => {
    if (held !== event.pointerId) return;
    held = null;
    clearInterval(timer);
    where = [0, 0];
    knob.style.transform = "";
    pad.classList.remove("held");
    send(true);
  };
  pad.addEventListener("pointerdown", (event) => {
    if (held !== null || silence() > 1) return;
    pad.setPointerCapture(event.pointerId);
    held = event.pointerId;
    pad.classList.add("held");
    place(event);
    send();
    timer = setInterval(send, PERIOD);
  });
  pad.addEventListener("pointermove", (event) => { if (held === event.pointerId) place(event); });
  pad.addEventListener("pointerup", release);
  pad.addEventListener("pointercancel", release);
  pad.addEventListener("contextmenu", (event) => event.preventDefault());
}
