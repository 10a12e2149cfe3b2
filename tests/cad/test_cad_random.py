"""Random dimensions: each set gives gated solids or one line, and never anything else."""

from __future__ import annotations

import pytest
from closed_forms import held
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.cad_random import drawn, names_a_key, numbers
from benchmarks.cad_random import outcome as checked
from deltact_fab import cache
from deltact_fab.cad import feasibility
from deltact_fab.cad.design import load_design
from deltact_fab.cad.registry import of_design
from deltact_fab.errors import InputError

PARTS = of_design()


@st.composite
def changes(draw: st.DrawFn) -> list[str]:
    """One to five keys: near their default, or at and past an end of their limits."""
    drawn = []
    chosen = draw(st.lists(st.sampled_from(numbers()), min_size=1, max_size=5, unique=True))
    for key, default, low, high, whole in chosen:
        value = draw(
            st.one_of(
                st.floats(0.8, 1.25).map(lambda factor, d=default: factor * d),
                st.floats(0.97, 1.05).map(lambda factor, d=default: factor * d),
                st.sampled_from([low, high, 0.0, -default, low * 0.999, high * 1.001]),
            )
        )
        drawn.append(f"{key}={round(value) if whole else repr(float(value))}")
    kind = draw(st.sampled_from(["block", "franka", "plate"]))
    return [*drawn, f"mount.kind={kind}"]


def outcome(change: list[str], parts: list) -> str:
    """'built' with each part gated and of its closed form's volume, or 'refused'."""
    try:
        design = load_design("deltact", change)
        feasibility.check(design)
    except InputError as why:
        return "refused" if "\n" not in str(why) else f"more than one line: {why}"
    if not all(fit.holds for part in PARTS for fit in part.fits(design)):
        return "refused"  # by a row that names its key
    for part in parts:
        held(part, design)
    return "built"


@pytest.mark.slow
def test_random_designs_give_gated_solids_or_one_line():
    """Of each set three parts in turn, so that every part is built of several."""
    seen = {"built": 0, "refused": 0}

    @settings(
        max_examples=30,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(changes())
    def each(change):
        start = 3 * sum(seen.values())
        seen[outcome(change, [PARTS[(start + k) % len(PARTS)] for k in range(3)])] += 1

    each()
    assert seen["built"] >= 5, f"most sets are refused, the draw tests little: {seen}"


@pytest.mark.slow
def test_the_draw_of_the_benchmark_is_the_same_again_and_goes_far():
    """`python -m benchmarks.cad_random` checks such designs on their solids by the hundred."""
    assert drawn(3) == drawn(3)
    widths = [float(drawn(i)[0].partition("=")[2]) for i in range(40)]
    assert min(widths) < 30 < 55 < max(widths)
    assert names_a_key("screw: 2 x thread M3 <= screw.engagement_mm: 6 <= 4.6 fails")
    assert not names_a_key("shell closes a chain: 14.5 (left)")


@pytest.mark.slow
def test_a_random_design_passes_or_names_a_key(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path))
    found = checked(1000)
    assert found["outcome"] in ("passed", "rows", "refused"), found
    assert found.get("named", True), found
