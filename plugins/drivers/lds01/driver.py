"""The thread that listens to a lidar."""

from contextlib import suppress
from threading import Thread
from typing import get_args

from knotwork.core import clock
from knotwork.core.contracts import Context, Driver
from knotwork.core.devices.backoff import Backoff
from knotwork.core.devices.errors import DeviceLost
from knotwork.core.devices.serial_port import SerialPort
from knotwork.core.devices.wake import Wake
from knotwork.core.errors import DriverError
from knotwork.core.messages import Scan
from knotwork.plugins.drivers.lds01 import Config
from knotwork.plugins.drivers.lds01.models import Model, make

_LISTEN = 0.25  # s that a read waits
_NUDGE_AFTER = 2.0  # s of silence, then the start command again
_REOPEN_AFTER = 6.0  # s of silence, then the port is opened anew
_TRY_MODEL = 1.5  # s that `auto` listens for each model; a head takes 2 s to spin up
_ROUNDS = 4
_ENOUGH = 3  # good packets that tell a model
_BLIND_TURNS = 10
_BLIND = 0.02  # share of valid readings


class Lds(Driver):
    """Emits a scan a turn; nothing in the stream of bytes stops it, an unplugged device is waited for."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        self._port: SerialPort | None = None
        self._model: Model | None = None if self.config.model == "auto" else make(self.config.model, self.config)
        self._wake = Wake()
        self._thread: Thread | None = None
        self._ended = False
        self._last = 0  # arrival of the last good packet [ns]
        self._heard = 0  # the same, or when the port was opened [ns]
        self._nudged = 0
        self._blind = 0
        self._odd_speed = False
        self._crash: Exception | None = None
        context.every(0.1, self._look_after)

    def last_packet(self) -> int:
        """Return when the last good packet arrived [ns], 0 before the first."""
        return self._last

    def open(self) -> None:
        """Open the port and start the motor; raises DriverError."""
        try:
            self._connect()
        except DeviceLost as lost:
            raise DriverError(str(lost), where=self.config.port) from lost

    def start(self) -> None:
        """Start the thread; what came while other devices were opened is old, and cut by a full buffer."""
        self._heard = self._nudged = clock.epoch()
        with suppress(DeviceLost):  # the thread will find out
            if self._port is not None and self._model is not None:
                self._port.flush_input()
                self._model.reset()
        self._thread = Thread(target=self._run, name=f"lidar {self.context.name}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def close(self) -> None:
        """Stop the motor and close the port."""
        port, self._port = self._port, None
        if port is None:
            return
        with suppress(DeviceLost):
            if self._model is not None and self._model.stop_command:
                port.write(self._model.stop_command)
        port.close()

    def statistics(self) -> dict[str, float]:
        """Return what arrived, what was refused, and the speed of the head."""
        model = self._model
        if model is None:
            return {}
        parser = model.parser
        return {
            "scans": model.scans,
            "packets": parser.packets,
            "rejected_packets": parser.rejected,
            "skipped_bytes": parser.skipped,
            "missing_packets": model.missing,
            "misplaced_packets": model.misplaced,
            "rpm": round(model.rpm, 1),
        }

    def _connect(self) -> None:
        if self._model is None:
            self._model = self._find()
            return
        self._open(self._model)

    def _open(self, model: Model) -> None:
        self._port = SerialPort(self.config.port, model.baud)
        self._port.flush_input()
        model.reset()
        if model.start_command:
            self._port.write(model.start_command)
        self._heard = self._nudged = clock.epoch()

    def _find(self) -> Model:
        """Listen for each model in turn; raises DriverError when nothing is understood."""
        names = [name for name in get_args(Config.model_fields["model"].annotation) if name != "auto"]
        for _ in range(_ROUNDS):
            for name in names:
                model = make(name, self.config)
                self._open(model)
                assert self._port is not None
                until = clock.monotonic() + round(_TRY_MODEL * 1e9)
                while (left := until - clock.monotonic()) > 0:
                    model.feed(self._port.read(left * 1e-9), clock.epoch())
                    if model.parser.packets >= _ENOUGH:
                        self.context.report("info", f"the lidar is an {name}")
                        fresh = make(name, self.config)
                        fresh.reset()
                        return fresh
                self._port.close()
        raise DriverError(
            f"neither {' nor '.join(names)} speaks there", where=self.config.port, hint="is the lidar turning?"
        )

    def _run(self) -> None:
        backoff = Backoff()
        lost_at = 0
        while not self._ended:
            try:
                if self._port is None:
                    self._connect()
                    self.context.count("reconnects")
                    self.context.report("info", f"back after {(clock.epoch() - lost_at) * 1e-9:.1f} s")
                    backoff.reset()
                self._listen()
            except (DeviceLost, DriverError) as error:
                port, self._port = self._port, None
                if port is not None:
                    port.close()
                    lost_at = clock.epoch()
                    self.context.count("lost")
                    self.context.report("warning", f"lost the lidar: {error}; trying to reach it again")
                self._wake.wait(backoff.delay())
            except Exception as error:  # noqa: BLE001 - raised again in the run's own thread, see `_look_after`
                self._crash = error
                return

    def _listen(self) -> None:
        port, model = self._port, self._model
        assert port is not None
        assert model is not None
        descriptor = (self._wake.fileno(),)
        while not self._ended:
            data = port.read_all(_LISTEN, descriptor)
            now = clock.epoch()
            packets, scans = model.feed(data, now)
            if packets:
                self._last = self._heard = self._nudged = now
            for scan in scans:
                self._watch(scan, model)
                self.context.emit("scan", scan)
            if not packets:
                self._nudge(now, port, model)

    def _nudge(self, now: int, port: SerialPort, model: Model) -> None:
        if now - self._heard > _REOPEN_AFTER * 1e9:
            raise DeviceLost(f"no packet for {_REOPEN_AFTER:g} s")
        if now - self._nudged > _NUDGE_AFTER * 1e9:
            self._nudged = now
            self.context.count("silences")
            self.context.report("warning", f"the lidar has been silent for {(now - self._heard) * 1e-9:.0f} s")
            if model.start_command:
                port.write(model.start_command)

    def _watch(self, scan: Scan, model: Model) -> None:
        """Tell a person of a window that sees nothing, and of a motor at an odd speed."""
        seen = float((scan.ranges == scan.ranges).mean())
        self._blind = self._blind + 1 if seen < _BLIND else 0
        if self._blind == _BLIND_TURNS:
            self.context.report("warning", "the lidar turns but sees nothing: dirty window, sunlight, cable?")
        low, high = model.speeds
        odd = not low <= model.rpm <= high
        if odd and not self._odd_speed:
            self.context.report("warning", f"the lidar turns at {model.rpm:.0f} rpm, expected {low:g} to {high:g}")
        if odd:
            self.context.count("odd_speed_turns")
        self._odd_speed = odd

    def _look_after(self, time: int) -> None:
        """Let a mistake in the thread end the run, as any node's does."""
        if self._crash is not None:
            raise self._crash
