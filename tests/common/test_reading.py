"""Files are read within limits, and messages are one line."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from deltact_fab.common import catalog, reading
from deltact_fab.common.errors import InputError, fault_line
from deltact_fab.fabricate.patterns.recipe import PatternRecipe


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"a = 1\n" * 10**6, "larger than 4 MiB"),
        (b"a = 1\n" * 200_000, "more than 20000 keys"),
        (b"a = " + b"[" * 5000 + b"]" * 5000, "nested too deep"),
        (b".".join([b"a"] * 20_000) + b" = 1", "nested too deep"),
        (b"a = " + b"[" * 40 + b"]" * 40, "nested too deep"),
        (b"a = " + b"9" * 100, "an integer of 333 bits"),
        (b"a = " + b"9" * 5000, "not valid TOML"),
        (b"a = '\xff'", "not UTF-8 text: byte 5 is 0xff"),
        (b"a = 1\0", "not valid TOML"),
    ],
)
def test_excessive_files_are_refused_at_once(tmp_path: Path, data: bytes, says: str) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(data)
    begun = time.process_time()
    with pytest.raises(InputError, match=says):
        reading.read_toml(file)
    assert time.process_time() - begun < 1


def test_first_of_many_faults_are_reported() -> None:
    begun = time.process_time()
    with pytest.raises(InputError, match=r"^f: law: missing .* \| and 9981 more$") as told:
        catalog.validate(PatternRecipe, {f"key_{i}": 1 for i in range(10_000)} | {"seed": 1}, "f")
    assert time.process_time() - begun < 2
    told_of = fault_line(*told.value.faults, untold=told.value.untold)
    assert (len(told_of) <= 300, told_of.endswith(" more")) == (True, True)
    assert told.value.untold == 9981


def test_unreadable_paths_are_named(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in (".", "loop", "gone", "x" * 300, "a\0b"):
        with pytest.raises(InputError, match="cannot be read"):
            reading.read_toml(tmp_path / name)


def test_json_is_an_object(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("[1]")
    with pytest.raises(InputError, match="an object is needed"):
        reading.read_json(tmp_path / "x.json")


def test_message_is_one_short_printable_line() -> None:
    assert fault_line("a\n b\u202e") == "a b\\u202e"
    assert fault_line("x" * 300) == "x" * 300
    short = fault_line(f"f.toml: name: unknown {'y' * 1000!r}; valid: a, b")
    assert short.startswith("f.toml: name: unknown 'yyy")
    assert short.endswith("; valid: a, b")
    many = fault_line(*(f"f.toml: key_{n}: missing key" for n in range(100)), untold=5)
    assert many.startswith("f.toml: key_0: missing key | ")
    assert many.endswith(f" | and {105 - many.count('missing')} more")
    for faults in (["a b " * 500], ["w " * 290, "v " * 400]):
        assert len(fault_line(*faults)) <= 300


def test_pipe_is_read_and_fifo_refused(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.write(write, b"a = 1")
    os.close(write)
    assert reading.read_toml(Path(f"/dev/fd/{read}")) == {"a": 1}
    os.close(read)
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(InputError, match=r"a\.toml: is a FIFO"):
        reading.read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("value", ["NaN", "-Infinity", "1e999"])
def test_json_numbers_are_finite(value: str) -> None:
    with pytest.raises(InputError, match=r"s\.json: .*scale: must be a finite number"):
        reading.parse_json(f'{{"a": [{{"scale": {value}}}]}}', "s.json")


def test_json_of_many_values_is_refused() -> None:
    with pytest.raises(InputError, match="more than 1000000 values"):
        reading.parse_json(b'{"a": [' + b"{}," * 500_000 + b"{}]}", "s.json")
