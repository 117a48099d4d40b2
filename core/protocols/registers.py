"""A register of a control table: where it is and how its bytes make a number."""

import struct
from typing import NamedTuple


class Register(NamedTuple):
    """One item of a control table, little-endian.

    Attributes
    ----------
    address
    kind
        Format of the `struct` module: B b H h I i f.
    """

    address: int
    kind: str

    @property
    def size(self) -> int:
        """Number of bytes."""
        return struct.calcsize(self.kind)

    @property
    def end(self) -> int:
        """Address after the last byte."""
        return self.address + self.size

    def pack(self, value: float) -> bytes:
        """Return the bytes of a value; raises struct.error if it does not fit."""
        return struct.pack("<" + self.kind, value if self.kind == "f" else int(value))

    def unpack(self, block: bytes | bytearray, base: int) -> float:
        """Read the register from a block of bytes that starts at address `base`.

        Raises
        ------
        struct.error
            The block does not hold all of it.
        """
        if self.address < base:
            raise struct.error(f"register {self.address} lies before the block at {base}")
        value: float = struct.unpack_from("<" + self.kind, block, self.address - base)[0]
        return value


def span(*registers: Register) -> tuple[int, int]:
    """Return address and length of the smallest block that holds all of them."""
    first = min(register.address for register in registers)
    return first, max(register.end for register in registers) - first
