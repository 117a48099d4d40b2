"""The recorder: two channels a stream, whole chunks, a flush each second, a full disk survived.

Lossless: topic `/knotwork/<node>/<port>`, encoding `msgpack` (knotwork.core.codec), schema
`knotwork.<type>`; this is what a replay reads. View: topic `/<node>/<port>`, or `/tf` for transforms,
under a schema viewers know. Log time is the message's `time`, publish time its `stamp`.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

import msgspec

from knotwork import __version__
from knotwork.core import codec
from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.log.reader import ENCODING, PREFIX, RUN, SCHEMA_PREFIX
from knotwork.core.log.writer import McapWriter, sync
from knotwork.core.message_types import is_wall_clock
from knotwork.core.messages import Message
from knotwork.core.views import View, views
from knotwork.plugins.sinks.mcap import McapConfig


@dataclass(slots=True)
class _View:
    view: View
    topic: str
    channel: int = 0  # 0 until the first message that it renders


@dataclass(slots=True)
class _Stream:
    channel: int
    metadata: dict[str, str]
    views: list[_View]


class McapRecorder(Sink):
    """Records messages; `on_message`, `close` from one thread, a second thread flushes.

    The flush and fsync periods are wall time: they bound what a crash can take, and no message
    depends on them.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: McapConfig = context.config
        self._config = config
        self._splits = config.split_size > 0 or config.split_time > 0
        self._part = 0
        self.path = self._part_path(0)
        self._part_begun: int | None = None  # time of its first message [ns]
        self._part_base = 0  # bytes from which its growth counts
        self._writer: McapWriter | None = None
        self._file: Any = None
        self._lock = Lock()  # guards the writer
        self._streams: dict[tuple[str, type[Message]], _Stream | None] = {}
        self._schemas: dict[str, int] = {}
        self._shared: dict[tuple[str, str], int] = {}  # (topic, schema) of a shared view to its channel
        self._placed: dict[str, str] = {}  # frame to the stream that places it
        self._unfit: set[str] = set()  # streams with messages that have no binary form
        self._failure: OSError | None = None  # why writing fails; None while it does not
        self._failed_size = -1  # bytes of the file when the failure was reported; -1 before
        self._totals: dict[str, float] = {}
        self._before: dict[str, float] = {}  # figures of the files that are finished
        self._stop = Event()
        self._flusher = Thread(target=self._flush_each_period, name=f"{context.name}-flush", daemon=True)

    def open(self) -> None:
        """Create the file and write what is known of the run.

        Raises
        ------
        KnotworkError
            The file cannot be created.
        """
        if self._config.views:
            views("")  # imports the schemas now, not while messages wait
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file, self._writer = self._begin(self.path)
        except OSError as error:
            raise KnotworkError(
                f"cannot write the log: {error.strerror}",
                where=str(self.path),
                hint="free some space, or set `path` to a folder that you may write to",
            ) from error
        self._flusher.start()

    def _begin(self, path: Path) -> tuple[Any, McapWriter]:
        """Create a file with what is known of the run; raises OSError and leaves none open."""
        config = self._config
        file = self._create(path)
        try:
            writer = McapWriter(
                file,
                compression=config.compression,
                level=config.level,
                chunk_size=config.chunk_size,
                library=f"knotwork {__version__}",
            )
            run = self.context.run | ({"part": self._part} if self._splits else {})
            writer.add_metadata(RUN, {key: _text(value) for key, value in run.items()})
            writer.flush()
        except OSError:
            file.close()
            raise
        return file, writer

    def _part_path(self, part: int) -> Path:
        path: Path = self.context.out / self._config.path
        return path.with_name(f"{path.stem}.{part:04d}{path.suffix}") if self._splits else path

    def _split_when_due(self, time: int) -> None:
        """Begin the next file when this one has grown or lasted enough; the old one is finished."""
        writer, config = self._writer, self._config
        assert writer is not None
        if self._part_begun is None:
            self._part_begun = time
        grown = config.split_size > 0 and writer.size - self._part_base >= config.split_size
        lasted = config.split_time > 0 and time - self._part_begun >= config.split_time * 1e9
        if not (grown or lasted):
            return
        self._part_begun, self._part_base = time, writer.size
        self._part += 1
        path = self._part_path(self._part)
        try:
            file, fresh = self._begin(path)
        except OSError as error:
            self._part -= 1
            self.context.count("failed_splits")
            self.context.report("error", f"{path}: cannot be begun: {error.strerror}; {self.path.name} goes on")
            return
        self._end(writer, self._file)
        self._before = self._figures(writer)
        self.path, self._file, self._writer, self._part_base = path, file, fresh, 0
        self._streams.clear()
        self._schemas.clear()
        self._shared.clear()
        self._failure, self._failed_size = None, -1

    def _end(self, writer: McapWriter, file: Any) -> None:
        """Write the indexes and close."""
        try:
            writer.finish()
            sync(file)
        except OSError as error:
            self.context.report(
                "error",
                f"{self.path}: no index: {error.strerror}; {writer.dropped} records were dropped "
                f"(knotwork log recover {self.path})",
            )
        finally:
            file.close()

    @staticmethod
    def _create(path: Path) -> Any:
        return path.open("wb", buffering=0)

    def on_message(self, stream: str, message: Message) -> None:
        """Write one message and its views."""
        self.on_messages(iter([(stream, message)]))

    def on_messages(self, messages: Iterator[tuple[str, Message]]) -> None:
        """Write messages and their views."""
        streams, splits = self._streams, self._splits
        with self._lock:
            for stream, message in messages:
                key = (stream, type(message))
                try:
                    if splits:
                        self._split_when_due(message.time)
                    if key in streams:
                        found = streams[key]
                    else:
                        streams[key] = None
                        found = streams[key] = self._register(stream, message)
                    if found is not None:
                        self._write(stream, found, message)
                except KnotworkError as error:
                    self.context.count("unfit_messages")
                    if stream not in self._unfit:
                        self._unfit.add(stream)
                        self.context.report("error", f"{stream} is not fully recorded: {error}")
        if self._failure is not None:
            self._report_failure()

    def close(self) -> None:
        """Write the indexes; the file is then finished."""
        self._stop.set()
        if self._flusher.is_alive():
            self._flusher.join()
        if self._failure is not None and self._writer is not None:
            self._report_failure()
        writer, self._writer = self._writer, None
        if writer is None or self._file is None:
            return
        self._end(writer, self._file)
        self._totals = self._figures(writer)

    def statistics(self) -> dict[str, float]:
        """Return records (messages and views) written and dropped, and bytes, of all files."""
        return self._totals if self._writer is None else self._figures(self._writer)

    def _figures(self, writer: McapWriter) -> dict[str, float]:
        now = {"records": writer.messages, "dropped": writer.dropped, "bytes": writer.size}
        return {name: value + self._before.get(name, 0) for name, value in now.items()}

    def _register(self, stream: str, message: Message) -> _Stream | None:
        """Make the channel of a new stream; None when it is not recorded."""
        config, name = self._config, message.type_name
        if not any(fnmatchcase(stream, pattern) for pattern in config.include):
            return None
        if any(fnmatchcase(stream, pattern) for pattern in config.exclude):
            return None
        assert self._writer is not None
        topic = stream.replace(".", "/")
        metadata = {
            "stream": stream,
            "type": name,
            "role": getattr(message, "role", ""),
            "knotwork": __version__,
        }
        if is_wall_clock(name):
            metadata["wall_clock"] = "true"
        schema = self._schema(SCHEMA_PREFIX + name, "jsonschema", lambda: codec.json_schema(type(message)))
        channel = self._writer.register_channel(PREFIX + topic, ENCODING, schema, metadata)
        shown = [_View(view, view.topic or "/" + topic) for view in views(name)] if config.views else []
        return _Stream(channel, {**metadata, "view_of": PREFIX + topic}, shown)

    def _write(self, stream: str, found: _Stream, message: Message) -> None:
        assert self._writer is not None
        add = self._writer.add
        log_time, stamp, seq = message.time, message.stamp, message.seq
        if log_time < 0 or stamp < 0 or seq < 0:
            log_time, stamp, seq = max(log_time, 0), max(stamp, 0), max(seq, 0)
        data = codec.encode(message)
        try:
            add(found.channel, log_time, stamp, seq, data)
        except OSError as error:
            self._failure = error
        for shown in found.views:
            view, frame = shown.view, ""
            if view.places is not None:
                frame = view.places(message)
                if self._placed.get(frame, stream) != stream:
                    continue
            shape = view.render(message)
            if shape is None:
                continue
            if frame:
                self._placed[frame] = stream
            if not shown.channel:
                shown.channel = self._view_channel(shown, found)
            try:
                add(shown.channel, log_time, stamp, seq, shape)
            except OSError as error:
                self._failure = error

    def _view_channel(self, shown: _View, found: _Stream) -> int:
        assert self._writer is not None
        view = shown.view
        key = (shown.topic, view.schema)
        channel = self._shared.get(key)
        if channel is None:
            schema = self._schema(view.schema, view.schema_encoding, lambda: view.definition)
            metadata = {k: v for k, v in found.metadata.items() if k in ("view_of", "wall_clock") and not view.topic}
            channel = self._writer.register_channel(shown.topic, view.encoding, schema, {"view": "true", **metadata})
            self._shared[key] = channel
        return channel

    def _schema(self, name: str, encoding: str, data: Any) -> int:
        assert self._writer is not None
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, data())
        return self._schemas[name]

    def _flush_each_period(self) -> None:
        """Flush and fsync until the recorder closes; a slow disk holds up nobody but this thread."""
        config = self._config
        flushes_a_sync = max(round(config.fsync / config.flush), 1)
        flushes = 0
        while not self._stop.wait(config.flush):
            flushes += 1
            try:
                with self._lock:
                    file = self._file
                    if self._writer is not None:
                        self._writer.flush()
                if config.fsync and flushes % flushes_a_sync == 0:
                    with suppress(ValueError):  # a split has closed it meanwhile, after a sync
                        sync(file)
            except OSError as error:
                self._failure = error

    def _report_failure(self) -> None:
        """Say once that writing fails, and once that it goes on."""
        writer, failure = self._writer, self._failure
        assert writer is not None
        assert failure is not None
        if self._failed_size < 0:
            self._failed_size = writer.size
            self.context.report(
                "error",
                f"{self.path}: {failure.strerror}: what is written is kept ({writer.size} bytes), "
                "messages are dropped until it can grow again",
            )
        elif writer.size > self._failed_size + 2 * self._config.chunk_size:  # not just what still found room
            self._failed_size, self._failure = -1, None
            self.context.report("warning", f"{self.path}: recording again; {writer.dropped} records were dropped")


def _text(value: Any) -> str:
    return msgspec.json.encode(value, enc_hook=str).decode()
