"""What the drivers of text logs share: the loop over lines, the window in time, the book of bad lines."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import DriverError
from knotwork.core.log_config import LogConfig
from knotwork.core.log_file import LogFile
from knotwork.core.messages import Message, Scan

_SHOWN = 5  # malformed lines reported one by one; the rest as a sum
_PATIENCE = 10_000  # malformed lines without a single good one: it is another format


class LogDriver(Driver):
    """A pulled driver of a text log, one record a line; its config is a `LogConfig`.

    A bad line is counted (`malformed_lines`), reported with its number and skipped; with `strict` it
    raises DriverError. Whatever was read before an error has been delivered.
    """

    expected: ClassVar[str]  # the format in words, for errors

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.settings: LogConfig = context.config
        self.scan_id = 0  # of the next scan
        self._malformed = 0
        self.remark = ""  # what a driver has to say when the log gives no scan
        self._first_problem = ""
        self._file: LogFile | None = None

    @abstractmethod
    def parse(self, line: bytes) -> Sequence[tuple[str, Message]]:
        """Return the messages of one line, at most one of them a scan; raise ValueError for a bad line."""

    def open(self) -> None:
        """Open the file; raises DriverError when it cannot be read."""
        self._file = LogFile(self.settings.path)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def events(self) -> Iterator[tuple[str, Message]]:
        """Yield `(port, message)` in the order of the log; raises DriverError for another format."""
        if self._file is None:
            self.open()
        assert self._file is not None
        file = self._file
        written = recognised = False
        for number, line in file.lines():
            written = written or bool(line.strip())
            try:
                messages = self.parse(line)
            except ValueError as problem:
                self._bad(number, str(problem))
                if not recognised and self._malformed >= _PATIENCE:
                    break
                continue
            if not messages:
                continue
            if not recognised:
                recognised = True
                first = latest = messages[0][1].stamp
            for port, message in messages:
                latest = max(latest, message.stamp)  # stamps may run backwards; the window must not flicker
                elapsed = (latest - first) / 1e9
                if self.settings.stop is not None and elapsed > self.settings.stop:
                    self._finish(file)
                    return
                if elapsed < self.settings.start:
                    continue
                if isinstance(message, Scan):
                    self.scan_id += 1
                yield port, message
            if self.settings.limit and self.scan_id >= self.settings.limit:
                break
        self._finish(file)
        if not recognised:
            raise self._unrecognised(file, written)
        if not self.scan_id:
            text = f"{file.path}: no scan in the part of the log that was read"
            self.context.report("warning", f"{text}; {self.remark}" if self.remark else text)

    def _bad(self, number: int, reason: str) -> None:
        where = f"{self.settings.path}:{number}"
        if self.settings.strict:
            raise DriverError(reason, where=where, hint="strict: false skips such lines")
        self._malformed += 1
        self.context.count("malformed_lines")
        self._first_problem = self._first_problem or f"line {number}: {reason}"
        if self._malformed <= _SHOWN:
            self.context.report("warning", f"{where}: {reason}; line skipped")

    def _finish(self, file: LogFile) -> None:
        if self._malformed > _SHOWN:
            self.context.report("warning", f"{file.path}: {self._malformed} malformed lines skipped in all")
        if file.damage:
            if self.settings.strict:
                raise DriverError(
                    file.damage, where=str(file.path), hint="strict: false keeps what could be read"
                )
            self.context.count("damaged_files")
            self.context.report("warning", f"{file.path}: {file.damage}; what came before it was read")

    def _unrecognised(self, file: LogFile, written: bool) -> DriverError:
        where = str(file.path)
        if not written and not file.damage:
            return DriverError(
                f"the file is empty, expected {self.expected}", where=where, hint="check the path"
            )
        found = "".join(f"; {text}" for text in (self.remark, self._first_problem) if text)
        return DriverError(
            f"nothing usable in the file, expected {self.expected}{found}",
            where=where,
            hint="check the path and the driver's plugin name",
        )
