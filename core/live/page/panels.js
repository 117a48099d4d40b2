// Everything beside the map.
import { state, robot, poseOf } from "./state.js";
import { COLOURS, ellipse, roundLength, view } from "./plane.js";

const $ = (id) => document.getElementById(id);

export function show() {
  showHead();
  showPlayback();
  if ($("robot-panel").open) { showRobot(); drawLens(); }
  showVision();
  showNodes();
  showStreams();
  showEvents();
  showMaps();
  // A camera alone has no plane to be seen on.
  const planar = [state.poses, state.scans, state.maps].some((section) => Object.keys(section).length);
  document.body.classList.toggle("no-plane", !planar && Object.keys(state.features).length + Object.keys(state.images).length > 0);
  $("robot-panel").hidden = !planar && !Object.keys(state.twists).length && !Object.keys(state.servo).length;
}

function showHead() {
  $("title").textContent = state.title || "Knotwork";
  document.title = state.title ? `${state.title} - Knotwork` : "Knotwork";
  $("time").textContent = clock(state.time);
  const motion = Object.values(state.motion)[0];
  $("motion").hidden = !motion;
  if (motion) {
    $("motion").textContent = motion.reason ? `${motion.state}: ${motion.reason}` : motion.state;
    $("motion").className = `badge ${motion.state === "ready" ? "good" : motion.state === "waiting" ? "wait" : "bad"}`;
  }
  const battery = Object.values(state.battery)[0];
  $("battery").hidden = !battery;
  if (battery) $("battery").textContent = `${fixed(battery.voltage, 1)} V`;
  $("stop").hidden = !state.stop;
  $("rearm").hidden = !(motion && ["fault", "emergency"].includes(motion.state));
  $("stick").hidden = !state.drive;
}

function clock(time) {
  if (!(time > 0)) return "";
  if (time > 1e8) return new Date(time * 1000).toISOString().slice(11, 21);
  return `${time.toFixed(1)} s`;
}

function showPlayback() {
  const playback = state.playback;
  $("playback").hidden = !playback;
  if (!playback) return;
  $("play").textContent = playback.paused ? "play" : "pause";
  const rate = $("rate"), value = playback.rate === null ? "" : String(playback.rate);
  if (document.activeElement !== rate) {
    if (![...rate.options].some((option) => option.value === value)) rate.add(new Option(value, value));
    rate.value = value;
  }
  const seek = $("seek");
  seek.hidden = !("place" in playback);
  if (!seek.hidden && document.activeElement !== seek) seek.value = playback.place;
}

function showRobot() {
  const estimate = poseOf("estimate"), prior = estimate?.prior ?? poseOf("prior"), truth = poseOf("truth"), rows = [["", "x", "y", "yaw"]];
  const place = (name, pose) => rows.push([name, `${fixed(pose.at[0], 3)} m`, `${fixed(pose.at[1], 3)} m`, `${fixed(degrees(pose.at[2]), 1)}°`]);
  const sigma = (name, pose) => pose.cov && rows.push([name, ...[pose.cov[0], pose.cov[2]].map((v) => `${fixed(100 * Math.sqrt(v), 1)} cm`), `${fixed(degrees(Math.sqrt(pose.cov[3])), 2)}°`]);
  if (estimate) { place("posterior", estimate); sigma("sigma", estimate); }
  if (prior) { place("prior", prior); sigma("sigma", prior); }
  if (truth) place("truth", truth);
  for (const [stream, t] of Object.entries(state.twists)) rows.push([stream, `${fixed(t.vx, 2)} m/s`, "", `${fixed(degrees(t.wz), 0)}°/s`]);
  if (estimate && "quality" in estimate) rows.push(["quality", `${Math.round(100 * estimate.quality)} %`, "", estimate.lost ? "LOST" : ""]);
  for (const servo of Object.values(state.servo)) rows.push(["servo", `phase ${servo.phase}`, "error", fixed(servo.error, 4)]);
  table($("robot"), rows);
}

function canvasOf(id) {
  const canvas = $(id), { width, height } = canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { pen, width, height };
}

// Prior and posterior around the posterior, as large as both ellipses allow.
function drawLens() {
  const estimate = poseOf("estimate") ?? robot(), prior = estimate?.prior ?? poseOf("prior");
  $("lens").hidden = !estimate;
  if (!estimate) return;
  const { pen, width, height } = canvasOf("lens");
  const reach = [prior, estimate].filter((pose) => pose?.cov).map((pose) => 2 * Math.sqrt(Math.max(pose.cov[0], pose.cov[2])) + Math.hypot(pose.at[0] - estimate.at[0], pose.at[1] - estimate.at[1]));
  const scale = 0.42 * height / roundUp(Math.max(...reach, 0.005));
  for (const pose of [prior, estimate]) {
    if (!pose) continue;
    pen.save();
    pen.translate(width / 2, height / 2);
    pen.scale(scale, -scale);
    pen.translate(pose.at[0] - estimate.at[0], pose.at[1] - estimate.at[1]);
    pen.lineWidth = 2 / scale;
    pen.strokeStyle = pen.fillStyle = COLOURS[pose.role];
    if (pose.role === "prior") pen.setLineDash([5 / scale, 4 / scale]);
    if (pose.cov) {
      ellipse(pen, pose.cov);
      const half = 2 * Math.sqrt(pose.cov[3]), far = 0.45 * height / scale;
      pen.beginPath();
      for (const side of [-half, half]) { pen.moveTo(0, 0); pen.lineTo(far * Math.cos(pose.at[2] + side), far * Math.sin(pose.at[2] + side)); }
      pen.stroke();
    }
    pen.beginPath();
    pen.arc(0, 0, 3.5 / scale, 0, 7);
    pen.fill();
    pen.restore();
  }
  const length = roundLength(70 / scale);
  pen.fillStyle = pen.strokeStyle = "#1f2430";
  pen.lineWidth = 2;
  pen.beginPath(); pen.moveTo(10, height - 10); pen.lineTo(10 + length * scale, height - 10); pen.stroke();
  pen.font = "12px system-ui";
  pen.fillText(length >= 0.01 ? `${+(100 * length).toPrecision(2)} cm` : `${+(1000 * length).toPrecision(2)} mm`, 10, height - 16);
}

function roundUp(length) { return 10 ** (Math.ceil(3 * Math.log10(length)) / 3); }

function showVision() {
  const image = Object.values(state.images).find((each) => each?.src), features = Object.values(state.features)[0];
  const depths = Object.values(state.depths), estimated = depths.find((each) => each.role !== "truth"), truth = depths.find((each) => each.role === "truth");
  $("vision-panel").hidden = !(image || features || estimated);
  if ($("vision-panel").hidden || !$("vision-panel").open) return;
  $("image").hidden = !image;
  if (image && $("image").src !== image.src) $("image").src = image.src;
  const shown = estimated ?? truth ?? features;
  $("vision").hidden = !shown;
  if (shown) drawFeatures(shown, features);
  const rows = [["feature", "depth", "sigma", truth ? "truth" : ""]];
  for (const [k, id] of (estimated?.ids ?? []).slice(0, 12).entries()) {
    const chi = estimated.chi[k], sigma = estimated.sigma?.[k], at = truth ? truth.ids.indexOf(id) : -1;
    rows.push([id, chi ? `${fixed(1 / chi, 2)} m` : "?", sigma && chi ? `${fixed(sigma / chi / chi, 2)} m` : "", at >= 0 ? `${fixed(1 / truth.chi[at], 2)} m` : ""]);
  }
  table($("depths"), rows.length > 1 ? rows : []);
}

// Near is warm, far is cold; a ring says how uncertain the depth is.
function drawFeatures(shown, features) {
  const { pen, width, height } = canvasOf("vision");
  const all = shown.points.concat(features?.points ?? []).filter(([x, y]) => x !== null && y !== null);
  const reach = Math.max(0.1, ...all.map(([x, y]) => Math.max(Math.abs(x) * height / width, Math.abs(y))));
  const scale = 0.45 * height / reach, put = ([x, y]) => [width / 2 + x * scale, height / 2 + y * scale];
  pen.strokeStyle = "#d9dce3";
  pen.beginPath(); pen.moveTo(width / 2, 0); pen.lineTo(width / 2, height); pen.moveTo(0, height / 2); pen.lineTo(width, height / 2); pen.stroke();
  pen.strokeStyle = "#6a7180";
  for (const point of features?.points ?? []) { const [x, y] = put(point); pen.strokeRect(x - 3, y - 3, 6, 6); }
  const chis = (shown.chi ?? []).filter((chi) => chi > 0), near = Math.max(...chis, 1e-6), far = Math.min(...chis, near);
  pen.font = "11px system-ui";
  for (const [k, point] of shown.points.entries()) {
    const [x, y] = put(point), chi = shown.chi?.[k];
    const share = chi > 0 && near > far ? (chi - far) / (near - far) : 0.5;
    pen.fillStyle = pen.strokeStyle = chi === undefined ? "#6a7180" : `hsl(${Math.round(230 - 220 * share)} 75% 45%)`;
    pen.beginPath(); pen.arc(x, y, 4, 0, 7); pen.fill();
    const sigma = shown.sigma?.[k];
    if (sigma && chi) { pen.beginPath(); pen.arc(x, y, 4 + Math.min(30, 20 * sigma / Math.abs(chi)), 0, 7); pen.stroke(); }
    pen.fillStyle = "#1f2430";
    pen.fillText(chi > 0 ? `${shown.ids[k]}: ${fixed(1 / chi, 2)} m` : `${shown.ids[k]}`, x + 7, y - 6);
  }
}

function showNodes() {
  const nodes = Object.values(state.statistics)[0]?.nodes ?? {}, rows = [["node", "n", "p95 ms", "max ms", "drops"]];
  for (const [name, row] of Object.entries(nodes)) {
    if (!row.n && !row.drops) continue;
    const cells = [name, row.n, fixed(row.p95_ms, 2), fixed(row.max_ms, 1), row.drops ?? ""];
    cells.own = name.includes(".");
    cells.bad = row.drops > 0 ? 4 : -1;
    rows.push(cells);
  }
  $("no-nodes").hidden = rows.length > 1;
  table($("nodes"), rows.length > 1 ? rows : []);
}

function showStreams() {
  const rows = [["stream", "messages", "Hz now"]];
  for (const [stream, n] of Object.entries(state.counts).sort()) rows.push([stream, n, fixed(state.rates[stream] ?? 0, 1)]);
  table($("streams"), rows);
}

let told = null;
function showEvents() {
  if (told === state.events) return;
  told = state.events;
  $("events").replaceChildren(...[...state.events].reverse().slice(0, 60).map(([level, node, text]) => {
    const line = document.createElement("li");
    line.className = level;
    line.textContent = `${node}: ${text}`;
    return line;
  }));
}

function showMaps() {
  const names = Object.keys(state.maps), choice = $("map");
  choice.hidden = names.length < 2;
  const listed = [...choice.options].map((option) => option.value);
  if (String(listed) === String(names)) return;
  choice.replaceChildren(...names.map((name) => new Option(name, name)));
  if (names.includes(view.map)) choice.value = view.map;
}

// Fill a table; its first row is the head. Rows are kept, so that a selection survives.
function table(element, rows) {
  while (element.rows.length > rows.length) element.deleteRow(-1);
  for (const [i, cells] of rows.entries()) {
    const row = element.rows[i] ?? element.insertRow();
    row.className = cells.own ? "own" : "";
    while (row.cells.length > cells.length) row.deleteCell(-1);
    for (const [k, text] of cells.entries()) {
      const cell = row.cells[k] ?? row.appendChild(document.createElement(i ? "td" : "th"));
      if (cell.textContent !== String(text)) cell.textContent = text;
      if (i) cell.className = cells.bad === k ? "bad" : "";
    }
  }
}

function fixed(value, digits) { return value === null || value === undefined || Number.isNaN(value) ? "" : value.toFixed(digits); }
function degrees(angle) { return angle * 180 / Math.PI; }
