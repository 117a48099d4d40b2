import gzip
import lzma

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from knotwork.core.errors import DriverError, InputError
from knotwork.core.log_file import LogFile

TEXT = b"".join(b"line %d\n" % i for i in range(1, 20001))
PACKERS = {"plain": bytes, "gzip": gzip.compress, "xz": lzma.compress}


def read(path):
    file = LogFile(path)
    lines = list(file.lines())
    file.close()
    return lines, file.damage


@pytest.mark.parametrize("packer", PACKERS)
def test_content_decides_how_to_unpack_not_the_name(tmp_path, packer):
    path = tmp_path / "log.gz.xz.txt"
    path.write_bytes(PACKERS[packer](TEXT))
    lines, damage = read(path)
    assert lines == list(enumerate(TEXT.splitlines(), start=1))
    assert damage == ""


def test_two_packed_parts_in_a_row_are_one_text(tmp_path):
    path = tmp_path / "log"
    for pack in (gzip.compress, lzma.compress):
        path.write_bytes(pack(TEXT) + pack(b"last"))
        assert read(path)[0][-1] == (20001, b"last")


@pytest.mark.parametrize("packer", ["gzip", "xz"])
def test_a_cut_packed_file_gives_whole_lines_and_says_so(tmp_path, packer):
    noise = bytes(range(33, 127)) * 3
    text = b"".join(b"%d %s\n" % (i, noise[i % 90 : i % 90 + i * 7 % 97]) for i in range(20000))
    packed = PACKERS[packer](text)
    path = tmp_path / "log"
    path.write_bytes(packed[: len(packed) * 2 // 3])
    lines, damage = read(path)
    assert 100 < len(lines) < 20000
    assert [line for _, line in lines] == text.splitlines()[: len(lines)]
    assert f"after line {len(lines)}" in damage


def test_a_line_without_end_is_given(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"a\n\nb")
    assert read(path)[0] == [(1, b"a"), (2, b""), (3, b"b")]


def test_a_huge_line_is_cut_and_the_next_one_keeps_its_number(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"a\n" + b"x" * (5 << 20) + b"\nb\nc")
    lines, damage = read(path)
    assert [number for number, _ in lines] == [1, 2, 3, 4]
    assert len(lines[1][1]) < 2 << 20
    assert lines[2:] == [(3, b"b"), (4, b"c")]
    assert damage == ""


@pytest.mark.parametrize("error", [DriverError, InputError])
def test_files_that_cannot_be_opened(tmp_path, error):
    with pytest.raises(error, match="no such file"):
        LogFile(tmp_path / "missing", error)
    with pytest.raises(error, match="is a directory"):
        LogFile(tmp_path, error)
    with pytest.raises(error, match="cannot be read"):
        LogFile("a\0b", error)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.binary(max_size=300),
    st.sampled_from([b"", b"\x1f\x8b\x08", b"\xfd7zXZ\x00\x00\x04", gzip.compress(b"a\nb"), lzma.compress(b"a\nb")]),
    st.integers(0, 80),
)
def test_any_bytes_are_lines_or_damage(tmp_path, noise, head, cut):
    path = tmp_path / "log"
    path.write_bytes(head[: len(head) - cut] + noise)
    lines, _ = read(path)
    assert [number for number, _ in lines] == list(range(1, len(lines) + 1))
