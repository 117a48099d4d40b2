// What the page knows; each look adds to it.
const SECTIONS = ["poses", "scans", "images", "features", "depths", "servo", "twists", "motion", "battery", "statistics"];
const MOST_HITS = 60000;
const HIT = 0.05; // m

export const state = {};

export function clear() {
  for (const name of SECTIONS) state[name] = {};
  Object.assign(state, { time: 0, counts: {}, paths: {}, maps: {}, events: [], hits: new Map(), title: "", rates: {} });
}
clear();

const counted = [];

export function take(look, redraw) {
  if (look.reset) clear();
  for (const name of SECTIONS) Object.assign(state[name], look[name]);
  for (const name of ["time", "counts", "playback", "drive", "stop", "title"]) if (name in look) state[name] = look[name];
  for (const [stream, path] of Object.entries(look.paths ?? {})) takePath(stream, path);
  for (const [stream, map] of Object.entries(look.maps ?? {})) takeMap(stream, map, redraw);
  if (look.events) state.events = state.events.concat(look.events).slice(-200);
  for (const scan of Object.values(look.scans ?? {})) takeScan(scan);
  countRates();
}

function takePath(stream, path) {
  const known = state.paths[stream] ??= { role: path.role, points: [] };
  known.points.length = Math.min(known.points.length, 2 * path.at);
  for (const value of path.points) known.points.push(value);
}

function takeMap(stream, map, redraw) {
  const known = state.maps[stream] ??= { tiles: new Map() };
  Object.assign(known, { resolution: map.resolution, side: map.side, corner: map.corner, bytes: map.bytes });
  const old = known.tiles;
  if (map.fresh) known.tiles = new Map();
  const target = known.tiles;
  for (const [i, j, png] of map.tiles) {
    const key = `${i},${j}`;
    const image = new Image();
    const before = old.get(key);
    if (before && map.fresh) target.set(key, before);
    image.onload = () => { target.set(key, { i, j, image }); redraw(); };
    image.src = `data:image/png;base64,${png}`;
  }
  state.hits.clear();
}

function takeScan(scan) {
  const bytes = Uint8Array.from(atob(scan.points), (c) => c.charCodeAt(0));
  scan.local = new Int16Array(bytes.buffer, 0, bytes.length >> 1); // cm, x y x y ...
  if (!scan.at || state.hits.size > MOST_HITS) return;
  const [x, y, yaw] = scan.at, c = Math.cos(yaw) / 100, s = Math.sin(yaw) / 100;
  for (let k = 0; k < scan.local.length; k += 2) {
    const i = Math.floor((x + c * scan.local[k] - s * scan.local[k + 1]) / HIT);
    const j = Math.floor((y + s * scan.local[k] + c * scan.local[k + 1]) / HIT);
    state.hits.set(i * 1048576 + j, [i * HIT, j * HIT]);
  }
}
export const HIT_SIDE = HIT;

function countRates() {
  const now = performance.now();
  counted.push({ now, counts: state.counts });
  while (counted.length > 2 && now - counted[1].now > 2000) counted.shift();
  const first = counted[0], span = (now - first.now) / 1000;
  if (span < 0.5) return;
  state.rates = {};
  for (const [stream, n] of Object.entries(state.counts)) state.rates[stream] = Math.max(0, (n - (first.counts[stream] ?? 0)) / span);
}

// The pose a page follows: the newest estimate, else the prior, else the truth.
export function robot() {
  for (const role of ["estimate", "prior", "truth"]) {
    const found = Object.values(state.poses).find((pose) => pose.role === role && pose.at);
    if (found) return found;
  }
  return null;
}
export function poseOf(role) { return Object.values(state.poses).find((pose) => pose.role === role && pose.at) ?? null; }
