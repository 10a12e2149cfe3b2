"""Names, paths, and validation in the user's words."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict

from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError
from deltact_fab.paths import shipped_folder
from deltact_fab.sensor.shapes.sensor import SensorDimensions


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    depth_mm: float = 1.0


class Outer(BaseModel):
    model_config = ConfigDict(extra="forbid")
    inner: Inner | None = None
    many: tuple[Inner, ...] = ()
    pair_mm: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Plain:
    sensor: SensorDimensions = field(default_factory=SensorDimensions)
    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


@pytest.mark.parametrize(
    ("kind", "data", "says"),
    [
        (
            Outer,
            {"inner": {"dept_mm": 1}},
            "f: inner.dept_mm: unknown key; did you mean 'depth_mm'",
        ),
        (Outer, {"many": [{"dept_mm": 1}]}, "f: many.0.dept_mm: unknown key; did you mean"),
        (Outer, {"inner": {"depth_mm": "8"}}, "f: inner.depth_mm: "),
        (Outer, {"inner": {"depth_mm": True}}, "f: inner.depth_mm: "),
        (Outer, {"pair_mm": [1.0]}, "f: pair_mm"),
        (Outer, {"many": "1 mm"}, "f: many: must be a list (got '1 mm')"),
        (Plain, {"sensor": {"frame": {"seat_mm": 6}}}, "unknown key; did you mean 'seat_y_mm'?"),
        (
            Plain,
            {"sensor": {"skin": {"width_mm": -1}}},
            "skin.width_mm: -1; expected 5 <= width_mm <= 200",
        ),
        (Plain, {"sensor": {"skin": {"width_mm": float("nan")}}}, "width_mm"),
        (SensorDimensions, {"skin": {"edge_fillet_mm": 18}}, "18.0 < 17.0 fails"),
    ],
)
def test_faults_name_file_and_key(kind: type, data: object, says: str) -> None:
    with pytest.raises(InputError) as caught:
        catalog.validate(kind, data, "f")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_toml_faults_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("a = = 1\n")
    with pytest.raises(InputError, match=r"x\.toml: not valid TOML"):
        catalog.read_toml(file)
    with pytest.raises(InputError, match="no such file"):
        catalog.find_file("cad", str(tmp_path / "y.toml"))
    with pytest.raises(InputError, match="is a folder"):
        catalog.find_file("cad", str(tmp_path))


def test_bare_name_prefers_local_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = catalog.find_file("patterns", "dense")
    assert shipped.parent == shipped_folder("patterns")
    Path("dense.toml").write_text('law = "transparent"\n')
    assert catalog.find_file("patterns", "dense") == Path("dense.toml")
    Path("patterns").mkdir()
    Path("patterns/dense.toml").write_text('law = "transparent"\n')
    assert catalog.find_file("patterns", "dense") == Path("patterns/dense.toml")


def test_file_of_other_kind_is_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("smoke.toml").write_text('law = "transparent"\n')
    assert catalog.find_file("protocols", "smoke").parent == shipped_folder("protocols")
    Path("mine.toml").write_text('law = "transparent"\n')
    with pytest.raises(InputError, match=r"mine.toml has none of capture, depths_mm"):
        catalog.find_file("protocols", "mine")
    assert "mine" in catalog.catalogue_names("patterns")
    assert "mine" not in catalog.catalogue_names("protocols")


def test_damaged_local_file_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("smoke.toml").write_text("name = [\n")
    with pytest.raises(InputError, match=r"smoke.toml: not valid TOML"):
        catalog.find_file("protocols", "smoke")
    assert "smoke" in catalog.catalogue_names("protocols")
