"""Search for the best pattern for a printer and a camera: rank candidates, confirm the best.

Candidates are rendered on a known drag of the face; the best are tracked on the finite-strain gel,
as in a pattern selection, with seeds that the search has not used.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from deltact_fab.bench import VirtualConfig, load_protocol
from deltact_fab.common import MM_PER_INCH, InputError, Note, RunFailed, toml_text, validate
from deltact_fab.fabricate import DEFAULT_SEED, PatternRecipe, load_recipe
from deltact_fab.present import ReportFigure, ReportTable, StudyResult
from deltact_fab.sensor import Printer, SensorDimensions

from .grid import GridJob, seed_of
from .pattern_questions import press_means
from .pattern_selection import frames, press_words
from .press_jobs import TrackingJob, cost_s, seed_groups, track_press
from .registry import StudyRequest, load_virtual_rig, parse_scale
from .scene import STUDY_RIG, PressScene, describe_bench
from .search_candidates import (
    MAX_PATCH_PX,
    MIN_BRIDGED_MM,
    MIN_COVERED_SHARE,
    MIN_PATCH_DOTS,
    MIN_PATCH_PX,
    PAPER_PATTERN,
    SEARCH_TRACKER,
    ProbeJob,
    candidates,
    confirmation_table,
    finalists,
    headlines,
    pattern_name,
    plot_errors_by_size,
    probe,
    rank_candidates,
    shorten_shear,
    thin_candidates,
)

SEARCH_PROTOCOL = "pattern-search"
MIN_CANDIDATES = 8  # by hand: fewer are no search
MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""By hand: 2500 px across the view take minutes per pattern; 300 px are too few."""
PROBE_COST_S = 3.0
"""By hand: CPU seconds of a candidate on one core, for the announced time only."""
SEARCH_LEFT_OUT = (
    Note("grey patterns", "printed with one ink, which the three-ink model does not cover; and "
            "the tracker needs colour for its consistency check"),
    Note("marker dots", "they are features themselves and would bias the error"),
    Note("the lens", "pinhole view: the search is for a scale in mm per pixel"),
    Note("the search's own gel", "its drag is a prescribed motion, without a solver"),
)  # fmt: skip


def run(request: StudyRequest) -> StudyResult:
    """Search, then confirm. Raises InputError for an invalid rig or option, RunFailed."""
    scale, rig = parse_scale(request.scale), request.rig or STUDY_RIG
    config, sensor = open_bench(rig, request.options.get("dpi"), request.options.get("mm_per_px"))
    mm_per_dot = MM_PER_INCH / config.virtual.printer.dpi
    pool = candidates(mm_per_dot, sensor.optics.mm_per_px)
    shipped = pattern_name(load_recipe())
    count = max(MIN_CANDIDATES, round(scale * len(pool)))
    among = thin_candidates(pool, count, (PAPER_PATTERN, shipped))
    full, source = load_protocol(SEARCH_PROTOCOL)
    protocol = shorten_shear(full, scale)
    scene = PressScene({SEARCH_PROTOCOL: protocol}, config, rig, source, sensor, request.seed)
    searches = [seed_of(request.seed, f"search {k}") for k in range(max(1, round(2 * scale)))]
    probes = [
        [GridJob(f"{name}, search {k}", probe, ProbeJob(config, sensor, _with_seed(recipe, s), s),
                 PROBE_COST_S)
         for k, s in enumerate(searches, start=1)]
        for name, recipe in among.items()
    ]  # fmt: skip
    done_jobs = request.solve([job for group in probes for job in group]).results
    probed = {name: [done_jobs[job.name] for job in group if job.name in done_jobs]
            for name, group in zip(among, probes, strict=True)}  # fmt: skip
    frame = rank_candidates(probed, among)
    best = finalists(frame, max(2, round(4 * scale)))
    chosen = list(dict.fromkeys([*best, PAPER_PATTERN, *([shipped] if shipped in among else [])]))
    scene.solve_gels(request)
    seeds = [seed_of(request.seed, f"held-out seed {k}") for k in range(max(2, round(5 * scale)))]
    groups = seed_groups(seeds, len(chosen))
    jobs = [
        [
            replace(scene, seed=0).job(
                f"{press}, held out {k}", SEARCH_PROTOCOL, press, track_press, TrackingJob,
                cost_s(frames(protocol, scene), len(chosen) * len(group)),
                patterns={name: among[name] for name in chosen}, seeds=group, method=SEARCH_TRACKER,
            )
            for press in scene.presses(SEARCH_PROTOCOL)
        ]
        for k, group in enumerate(groups, start=1)
    ]  # fmt: skip
    done_jobs = request.solve([job for group in jobs for job in group]).results
    errors: dict[str, dict[int, float]] = {name: {} for name in chosen}
    coverage: dict[str, list[float]] = {name: [] for name in chosen}
    losses: list[str] = []
    for group in jobs:
        if any(job.name not in done_jobs for job in group):
            continue
        parts = [done_jobs[job.name] for job in group]
        losses += [line for part in parts for line in part["refused"]]
        for name, seed, error_mm in press_means(parts, "mean_off_dots_mm"):
            errors[name][seed] = error_mm
        for name, _, share in press_means(parts, "coverage"):
            coverage[name].append(share)
    means = {name: float(np.mean(shares)) for name, shares in coverage.items() if shares}
    gel_table = confirmation_table(errors, means)
    winner = next((name for name in gel_table["pattern"] if name in best), None)
    if winner is None:
        raise RunFailed("pattern-search: no finalist was tracked on the gel")
    recipe = _with_seed(among[winner], DEFAULT_SEED).model_dump(mode="json", exclude_none=True)
    heads, bench = headlines(errors, best, winner), describe_bench(config, sensor)
    px = recipe["patch_mm"] / sensor.optics.mm_per_px
    dots = recipe["patch_mm"] / mm_per_dot
    about = [
        f"The best of {len(among)} patterns for this printer and camera, simulated:",
        f"{bench['printer']};",
        f"{bench['camera']}.",
        *(head.sentence for head in heads if head.told),
        "Any seed works.",
    ]
    return StudyResult(
        study=SEARCH_PROTOCOL,
        title="The best pattern for a printer and a camera",
        simulated=True,
        seed=request.seed,
        scale=request.scale,
        answer=(f"Print {winner}: patches of {px:.1f} camera pixels and {dots:.1f} printer dots.",),
        headlines=heads,
        tables=(
            ReportTable("confirmed", "Confirmed on the finite-strain gel. Means over "
                        f"{len(seeds)} seeds that the search has not used.", gel_table),
            ReportTable("candidates", f"The candidates. Means over {len(searches)} seeds, best "
                        "first; bridged_mm: the minimum.",
                        frame.drop(columns=["law", "patch_mm"])),
        ),
        figures=(
            ReportFigure(
                "errors",
                "Mean error by patch size: candidates on the search's drag (dots, by law), and "
                "those confirmed on the finite-strain gel with 95 % intervals over seeds "
                "(squares); simulated.",
                partial(plot_errors_by_size, frame, gel_table, among),
            ),
        ),
        settings={
            **bench,
            "candidates": f"{len(among)}, of at least {MIN_PATCH_DOTS:g} printer dots and "
            f"{MIN_PATCH_PX:g} to {MAX_PATCH_PX:g} camera pixels per patch (the paper's always)",
            "to be a finalist": f"tracker confident on {100 * MIN_COVERED_SHARE:.0f} % of "
            f"the moving pixels and bridges steps of {MIN_BRIDGED_MM:.1f} mm; one per law and size",
            "confirmed on": f"{press_words(protocol, scene)}, finite-strain gel of the rig {rig!r}",
            "friction": f"{protocol.specimen.friction:g}",
            "seeds": f"{len(searches)} of the search, {len(seeds)} held out: pattern, print and "
            "noise are redrawn with each",
        },
        notes=(
            "Printer and camera models have assumed, not measured, parameters: print the best few "
            "on one sheet and compare runs of your bench (`analyze compare`) before you commit.",
            *dict.fromkeys(f"not tracked on the gel: {line}" for line in losses),
        ),
        left_out=SEARCH_LEFT_OUT,
        files={"best-pattern.toml": toml_text(
            {k: v for k, v in recipe.items() if (k, v) != ("channels", 3)}, about)},
        extra={"best": {"pattern": winner, "recipe": recipe}},
    )  # fmt: skip


def _with_seed(recipe: PatternRecipe, seed: int) -> PatternRecipe:
    """Return the recipe with another seed."""
    return recipe.model_copy(update={"seed": seed})


def open_bench(
    rig: str, dpi: int | None = None, mm_per_px: float | None = None
) -> tuple[VirtualConfig, SensorDimensions]:
    """Virtual rig with a pinhole camera, and the sensor before it.

    dpi: of the printer; mm_per_px: of the camera; None for the rig's and the sensor's. Image sides
    are even, for the Bayer mosaic. Raises InputError for a real rig or a value out of range.
    """
    sensor, config = SensorDimensions(), load_virtual_rig(rig)[0]
    scale = sensor.optics.mm_per_px if mm_per_px is None else mm_per_px
    if not MIN_MM_PER_PX <= scale <= MAX_MM_PER_PX:  # NaN fails too
        raise InputError(
            f"pattern-search: mm_per_px: {scale:g}; expected {MIN_MM_PER_PX} to "
            f"{MAX_MM_PER_PX} mm of the face per pixel"
        )
    width, height = (2 * math.floor(mm / scale / 2 + 1e-9) for mm in sensor.optics.view_mm)
    optics = replace(sensor.optics, mm_per_px=scale, image_width_px=width, image_height_px=height)
    printer = config.virtual.printer
    if dpi is not None:
        printer = validate(Printer, asdict(printer) | {"dpi": dpi}, "pattern-search")
    simulator = config.virtual.model_copy(update={"lens": None, "printer": printer})
    config = config.model_copy(update={"virtual": simulator, "camera": None})
    return config, replace(sensor, optics=optics)
