// The map seen from above: x to the right, y up.
import { state, robot, HIT_SIDE } from "./state.js";

export const COLOURS = { estimate: "#d64521", prior: "#1f5ab4", truth: "#148558", scan: "#b01fa8" };
export const layers = { map: true, hits: true, path: true, scan: true, prior: true, truth: true };
export const view = { x: 0, y: 0, scale: 60, follow: true, map: "" }; // scale: px a metre

let canvas, pen, asked = false, touched = false;

export function setUp(element) {
  canvas = element;
  pen = canvas.getContext("2d");
  new ResizeObserver(redraw).observe(canvas);
  listenToPointers();
}

export function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; draw(); });
}

export function zoom(factor, px, py) {
  const { width, height } = canvas.getBoundingClientRect();
  const dx = (px ?? width / 2) - width / 2, dy = (py ?? height / 2) - height / 2;
  const scale = Math.min(Math.max(view.scale * factor, 0.5), 5000);
  if (!view.follow) { view.x += dx / view.scale - dx / scale; view.y -= dy / view.scale - dy / scale; }
  view.scale = scale;
  touched = true;
  redraw();
}

export function fit() {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y) => { box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y); box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y); };
  const map = state.maps[shownMap()];
  for (const { i, j } of map?.tiles.values() ?? []) {
    const side = map.side * map.resolution, [x, y, yaw] = map.corner, c = Math.cos(yaw), s = Math.sin(yaw);
    for (const [a, b] of [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]]) add(x + side * (c * a - s * b), y + side * (s * a + c * b));
  }
  for (const path of Object.values(state.paths)) for (let k = 0; k < path.points.length; k += 2) add(path.points[k], path.points[k + 1]);
  for (const [x, y] of state.hits.values()) add(x, y);
  if (!(box[2] >= box[0])) return;
  const { width, height } = canvas.getBoundingClientRect();
  view.x = (box[0] + box[2]) / 2;
  view.y = (box[1] + box[3]) / 2;
  view.scale = Math.min(width / (box[2] - box[0] + 1), height / (box[3] - box[1] + 1), 200);
  view.follow = false;
  redraw();
}

// The stream whose map is drawn: the chosen one, else the first; undefined without one.
export function shownMap() {
  const names = Object.keys(state.maps);
  return names.includes(view.map) ? view.map : names[0];
}

function draw() {
  const { width, height } = canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    if (!touched) view.scale = Math.min(width, height) / 10;
  }
  const at = robot();
  if (view.follow && at) [view.x, view.y] = at.at;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = "#dfe1e6";
  pen.fillRect(0, 0, width, height);
  pen.translate(width / 2, height / 2);
  pen.scale(view.scale, -view.scale);
  pen.translate(-view.x, -view.y);
  if (layers.map && shownMap()) drawMap(state.maps[shownMap()]);
  if (layers.hits) drawHits();
  if (layers.path) for (const path of Object.values(state.paths)) if (path.role !== "truth" || layers.truth) drawPath(path);
  if (layers.scan) for (const scan of Object.values(state.scans)) drawScan(scan);
  for (const pose of Object.values(state.poses)) drawPose(pose);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  drawScaleBar(width, height);
}

function drawMap(map) {
  const side = map.side * map.resolution, [x, y, yaw] = map.corner;
  pen.save();
  pen.translate(x, y);
  pen.rotate(yaw);
  pen.imageSmoothingEnabled = view.scale * map.resolution < 1;
  for (const { i, j, image } of map.tiles.values()) {
    pen.save();
    pen.translate(i * side, (j + 1) * side);
    pen.scale(1, -1);
    pen.drawImage(image, 0, 0, side * 1.0005, side * 1.0005);
    pen.restore();
  }
  pen.restore();
}

function drawHits() {
  pen.fillStyle = "#4a4f5c";
  for (const [x, y] of state.hits.values()) pen.fillRect(x, y, HIT_SIDE, HIT_SIDE);
}

function drawPath({ role, points }) {
  pen.strokeStyle = COLOURS[role] ?? "#666";
  pen.globalAlpha = role === "truth" ? 0.7 : 1;
  pen.lineWidth = (role === "truth" ? 1.5 : 2) / view.scale;
  pen.lineJoin = "round";
  pen.beginPath();
  for (let k = 0; k < points.length; k += 2) pen.lineTo(points[k], points[k + 1]);
  pen.stroke();
  pen.globalAlpha = 1;
}

function drawScan({ local, at }) {
  if (!at || !local) return;
  pen.save();
  pen.translate(at[0], at[1]);
  pen.rotate(at[2]);
  pen.fillStyle = COLOURS.scan;
  const side = 3.2 / view.scale;
  for (let k = 0; k < local.length; k += 2) pen.fillRect(local[k] / 100 - side / 2, local[k + 1] / 100 - side / 2, side, side);
  pen.restore();
}

function drawPose({ role, at, cov, lost }) {
  if (!at || (role in layers && !layers[role])) return;
  const size = 13 / view.scale;
  pen.save();
  pen.translate(at[0], at[1]);
  pen.lineWidth = 1.6 / view.scale;
  pen.strokeStyle = pen.fillStyle = COLOURS[role] ?? "#666";
  if (role === "prior") pen.setLineDash([4 / view.scale, 3 / view.scale]);
  if (cov) ellipse(pen, cov);
  pen.rotate(at[2]);
  pen.beginPath();
  for (const [a, b] of [[1, 0], [-0.7, 0.65], [-0.35, 0], [-0.7, -0.65]]) pen.lineTo(a * size, b * size);
  pen.closePath();
  if (role === "estimate" && !lost) pen.fill(); else pen.stroke();
  pen.restore();
}

// The 2-sigma ellipse of a covariance (xx, xy, yy) around the origin.
export function ellipse(onto, [xx, xy, yy]) {
  const mean = (xx + yy) / 2, root = Math.hypot((xx - yy) / 2, xy);
  const a = 2 * Math.sqrt(Math.max(mean + root, 0)), b = 2 * Math.sqrt(Math.max(mean - root, 0));
  if (!Number.isFinite(a) || a > 1e4) return;
  onto.beginPath();
  onto.ellipse(0, 0, a, b, 0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
  onto.stroke();
}

export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].find((step) => step * power <= most) * power;
}

function drawScaleBar(width, height) {
  const metres = roundLength(Math.min(width / 4, 160) / view.scale), length = metres * view.scale;
  const x = width - 14 - length, y = 56;
  pen.strokeStyle = pen.fillStyle = "#1f2430";
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(x, y - 5); pen.lineTo(x, y); pen.lineTo(x + length, y); pen.lineTo(x + length, y - 5);
  pen.stroke();
  pen.font = "12px system-ui";
  pen.textAlign = "center";
  pen.fillText(metres >= 1 ? `${metres} m` : `${+(metres * 100).toPrecision(3)} cm`, x + length / 2, y + 14);
}

function listenToPointers() {
  const fingers = new Map();
  let span = 0;
  const middle = () => { const all = [...fingers.values()]; return [all.reduce((s, f) => s + f[0], 0) / all.length, all.reduce((s, f) => s + f[1], 0) / all.length]; };
  const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (fingers.size === 2) span = spread();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = middle();
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    const after = middle();
    if (Math.hypot(after[0] - before[0], after[1] - before[1]) > 0) setFollow(false);
    view.x -= (after[0] - before[0]) / view.scale;
    view.y += (after[1] - before[1]) / view.scale;
    if (fingers.size === 2) { const now = spread(); zoom(now / span, ...after); span = now; }
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(-event.deltaY / 500), event.offsetX, event.offsetY); }, { passive: false });
}

export function setFollow(on) {
  view.follow = on;
  document.getElementById("follow").setAttribute("aria-pressed", String(on));
  redraw();
}
