"""The page's HTTP server: files, one stream of looks, commands by POST; standard library only.

Bound to this machine it needs no token, but refuses what another site's page could send: a foreign Host
(DNS rebinding), a foreign Origin, a POST that is not JSON. Bound to anything else it wants the token.
"""

import hmac
import ipaddress
import json
import socket
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.live.scene import Scene
from knotwork.core.live.viewers import Viewers

Commands = dict[str, Callable[[dict[str, Any]], None]]

_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_LONGEST_COMMAND = 4096  # bytes
_IDLE = 30.0  # s until a silent connection is closed


def is_local(host: str) -> bool:
    """Return whether an address to listen on is reachable from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class LiveServer:
    """Serves the page of one scene.

    Parameters
    ----------
    scene
    commands
        By name; each gets the command's JSON object and raises InputError when it makes no sense.
    host, port
        Where to listen; port 0 takes a free one.
    token
        What a request must carry, "" for none; needed unless `host` is this machine.
    period, patience, most
        As in `Viewers`.

    Raises
    ------
    InputError
        No token for an address others can reach.
    KnotworkError
        The address cannot be listened on.
    """

    def __init__(
        self,
        scene: Scene,
        commands: Commands,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str = "",
        period: float = 0.1,
        patience: float = 10.0,
        most: int = 32,
    ) -> None:
        if not is_local(host) and not token:
            raise InputError(f"the live page on {host} can be reached by others: it needs a token")
        self.viewers = Viewers(scene, period=period, patience=patience, most=most)
        self.commands = commands
        self.token = token
        self._host = host
        self.rejected = 0  # requests without the token, or from another site's page
        try:
            self._http = _Server((host, port), self)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise KnotworkError(
                f"cannot serve the live page on {host}:{port}: {reason}", hint="port 0 takes a free one"
            ) from error
        self._thread = Thread(
            target=self._http.serve_forever, kwargs={"poll_interval": 0.2}, name="live server", daemon=True
        )

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._http.server_address[1])

    @property
    def address(self) -> str:
        """What to open in a browser, without the token."""
        host = self._host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"

    @property
    def address_with_token(self) -> str:
        """What to open in a browser."""
        return self.address + (f"?token={self.token}" if self.token else "")

    def start(self) -> None:
        """Begin to serve."""
        self.viewers.start()
        self._thread.start()

    def stop(self) -> None:
        """Tell the viewers what is left, and end."""
        self.viewers.stop()
        if self._thread.is_alive():
            self._http.shutdown()
            self._thread.join(5.0)
        self._http.server_close()

    def statistics(self) -> dict[str, float]:
        """Return how many viewers there were at most, were dropped, refused, and requests rejected."""
        viewers = self.viewers
        return {
            "viewers_max": viewers.peak,
            "viewers_dropped": viewers.dropped,
            "viewers_refused": viewers.refused,
            "requests_rejected": self.rejected,
        }

    def allowed(self, headers: Any, query: dict[str, list[str]]) -> bool:
        """Return whether a request may look or command."""
        host = headers.get("Host", "")
        origin = headers.get("Origin", "")
        if origin and urlsplit(origin).netloc != host:
            return False
        if not self.token:
            return is_local(urlsplit(f"//{host}").hostname or "")
        given = (*query.get("token", ()), headers.get("X-Knotwork-Token", ""))
        return any(hmac.compare_digest(text.encode(), self.token.encode()) for text in given)


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, address: tuple[str, int], live: LiveServer) -> None:
        self.live = live
        self.handed_over: set[socket.socket] = set()
        if ":" in address[0]:
            self.address_family = socket.AF_INET6
        super().__init__(address, _Handler)

    def shutdown_request(self, request: Any) -> None:
        if request in self.handed_over:
            self.handed_over.discard(request)
        else:
            super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a client broke off."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    protocol_version = "HTTP/1.1"
    timeout = _IDLE
    server_version = "knotwork"
    sys_version = ""

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        if url.path == "/stream":
            self._stream(parse_qs(url.query))
        else:
            self._file(url.path.strip("/") or "index.html")

    def do_POST(self) -> None:
        live = self.server.live
        url = urlsplit(self.path)
        length = self.headers.get("Content-Length", "")
        if not length.isdigit() or int(length) > _LONGEST_COMMAND:
            self.close_connection = True
            self._answer(HTTPStatus.BAD_REQUEST, {"error": f"expected at most {_LONGEST_COMMAND} bytes of JSON"})
            return
        body = self.rfile.read(int(length))
        is_json = self.headers.get_content_type() == "application/json"
        if url.path != "/command":
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is only /command"})
        elif not is_json or not live.allowed(self.headers, parse_qs(url.query)):
            live.rejected += 1
            self._answer(HTTPStatus.FORBIDDEN, {"error": "wrong token, or not from this page"})
        else:
            self._command(body)

    def _command(self, body: bytes) -> None:
        commands = self.server.live.commands
        try:
            wanted = json.loads(body)
            name = wanted.get("do") if isinstance(wanted, dict) else None
            if not isinstance(name, str) or name not in commands:
                raise InputError(f"unknown command {name!r}, there are {', '.join(sorted(commands)) or 'none'}")
            commands[name](wanted)
        except (InputError, ValueError, TypeError) as error:
            self._answer(HTTPStatus.BAD_REQUEST, {"error": str(error)})
        else:
            self._answer(HTTPStatus.OK, {})

    def _stream(self, query: dict[str, list[str]]) -> None:
        live = self.server.live
        if not live.allowed(self.headers, query):
            live.rejected += 1
            self._answer(HTTPStatus.FORBIDDEN, {"error": "wrong token, or not from this page"})
            return
        self.close_connection = True
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.flush()
        if live.viewers.add(self.connection):
            self.server.handed_over.add(self.connection)

    def _file(self, name: str) -> None:
        found = _PAGE.get(name)
        if found is None:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "no such file"})
            return
        self._send(HTTPStatus.OK, _TYPES[name.rpartition(".")[2]] + "; charset=utf-8", found)

    def _answer(self, status: HTTPStatus, what: dict[str, str]) -> None:
        self._send(status, "application/json", json.dumps(what).encode())

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        with suppress(OSError):
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Stay silent."""


def _page() -> dict[str, bytes]:
    folder = files("knotwork.core.live") / "page"
    return {f.name: f.read_bytes() for f in folder.iterdir() if f.name.rpartition(".")[2] in _TYPES}


_PAGE = _page()
