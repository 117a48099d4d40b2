// The connection: looks come in as server-sent events, commands go out as POST.
const token = new URLSearchParams(location.search).get("token") ?? "";
const query = token ? `?token=${encodeURIComponent(token)}` : "";

export const link = { tick: 0, heard: 0, open: false };

export function listen(onLook) {
  const source = new EventSource(`stream${query}`);
  source.onopen = () => { link.open = true; };
  source.onerror = () => {
    link.open = false;
    if (source.readyState === EventSource.CLOSED) setTimeout(() => listen(onLook), 3000);
  };
  source.onmessage = (event) => {
    const look = JSON.parse(event.data);
    link.tick = look.tick;
    link.heard = performance.now();
    onLook(look);
  };
}

export function silence() { return link.heard ? (performance.now() - link.heard) / 1000 : Infinity; }

let onRefusal = () => {};
export function whenRefused(call) { onRefusal = call; }

export async function command(name, more = {}) {
  try {
    const answer = await fetch(`command${query}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ do: name, ...more }),
    });
    if (!answer.ok) onRefusal(name, (await answer.json()).error);
    return answer.ok;
  } catch {
    onRefusal(name, "the run cannot be reached");
    return false;
  }
}
