"""A TCP proxy on this machine whose cable can be pulled: connections stay, nothing passes."""

import select
import socket
import threading


class Proxy:
    def __init__(self, target: int):
        self.target = target
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self.stalled = False
        self.ending = False
        self.pairs: dict[socket.socket, socket.socket] = {}
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def cut(self) -> None:
        """Close all connections."""
        self.stalled = True
        for each in list(self.pairs):
            each.close()
        self.pairs.clear()

    def close(self) -> None:
        self.ending = True
        self.thread.join()
        for each in (*self.pairs, self.server):
            each.close()

    def _run(self) -> None:
        while not self.ending:
            if self.stalled:
                select.select([], [], [], 0.005)
                continue
            try:
                ready = select.select([self.server, *self.pairs], [], [], 0.02)[0]
            except (OSError, ValueError):
                continue
            for each in ready:
                if each is self.server:
                    self._accept()
                elif not self.stalled:
                    self._pass(each)

    def _accept(self) -> None:
        near, _ = self.server.accept()
        try:
            far = socket.create_connection(("127.0.0.1", self.target), timeout=1)
        except OSError:
            near.close()
            return
        for each in (near, far):
            each.settimeout(None)
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.pairs |= {near: far, far: near}

    def _pass(self, each: socket.socket) -> None:
        other = self.pairs.get(each)
        if other is None:
            return
        try:
            data = each.recv(65536)
            other.sendall(data)
        except OSError:
            data = b""
        if not data:
            for one in (each, other):
                self.pairs.pop(one, None)
                one.close()
