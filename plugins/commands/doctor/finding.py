"""What the doctor finds."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Finding:
    """One line; `mend` is what to type or do about it."""

    level: Literal["ok", "note", "problem"]
    what: str
    text: str
    mend: str = ""

    def __str__(self) -> str:
        """Render as one line, with the cure below."""
        line = f"{self.level:<9}{self.what}: {self.text}"
        return line + "".join(f"\n         -> {step}" for step in self.mend.splitlines())
