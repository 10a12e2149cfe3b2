"""The store finds what was put under the same key, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deltact_fab.common.cache import Store

STORE = Store("kind")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "c"))
    return tmp_path / "c"


def test_round_trip_by_key_content(folder: Path) -> None:
    key = {"a": 1, "b": [1, 2]}
    assert STORE.read(key) is None
    assert STORE.write(key, {"v": 2.5})
    assert STORE.read({"b": [1, 2], "a": 1}) == {"v": 2.5}
    assert STORE.read({"a": 2, "b": [1, 2]}) is None
    assert Store("other").read(key) is None
    assert len(list(folder.rglob("*"))) == 2


def test_nested_bytes_and_arrays_round_trip(folder: Path) -> None:
    data = b'{"line": 1}\n\x00\xff\nrest'
    arrays = [np.arange(6.0).reshape(2, 3).T, np.zeros((0, 11)), np.array(3), np.array(["ab", "c"])]
    value = {"file": data, "v": 0.1, "in": [{"array": array, "n": None} for array in arrays]}
    assert STORE.write({"a": 1}, value)
    held: Any = STORE.read({"a": 1})
    assert (held["file"], held["v"], len(held["in"])) == (data, 0.1, 4)
    for array, found in zip(arrays, held["in"], strict=True):
        assert (found["array"].dtype, found["n"]) == (array.dtype, None)
        np.testing.assert_array_equal(found["array"], array)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_any_changed_bit_is_a_miss(folder: Path, at: int, bit: int) -> None:
    STORE.write({"a": 1}, [b"some bytes", {"v": 0.1}])
    (entry,) = folder.rglob("*.bin")
    whole = bytearray(entry.read_bytes())
    whole[at % len(whole)] ^= 1 << bit
    entry.write_bytes(whole)
    assert STORE.read({"a": 1}) is None


def test_unwritable_folder_is_harmless(folder: Path) -> None:
    folder.write_text("a file in the way")
    assert STORE.write({"a": 1}, b"x") is False
    assert STORE.read({"a": 1}) is None
    assert STORE.trim(0) == 0


def test_trim_keeps_what_was_used_last(folder: Path) -> None:
    for n in range(5):
        STORE.write({"n": n}, b"x" * 1000)
    paths = {n: folder / STORE.file({"n": n}) for n in range(5)}
    for n, path in paths.items():
        os.utime(path, (1000 + n, 1000 + n))
    STORE.read({"n": 0})
    size = paths[0].stat().st_size
    assert STORE.trim(5 * size) == 0
    assert STORE.trim(2 * size + 1) == 3 * size
    assert {n for n, path in paths.items() if path.exists()} == {0, 4}
    assert STORE.trim(0, [{"n": 0}, {"n": 4}]) == 0
    assert STORE.read({"n": 4}) == b"x" * 1000
