"""The best pattern for a printer and a camera: candidates ranked, the best few confirmed.

Candidates are drawn on a known drag of the face; the best are followed on the gel at finite strain,
as in a pattern selection, with seeds that the search has not seen.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import partial

from deltact_fab.bench import VirtualConfig, load_protocol
from deltact_fab.common import MM_PER_INCH, InputError, Note, RunFailed, toml_text, validate
from deltact_fab.fabricate import DEFAULT_SEED, PatternRecipe, load_recipe
from deltact_fab.present import ReportFigure, ReportTable, StudyResult
from deltact_fab.sensor import Printer, SensorDimensions

from .grid import GridJob, seed_of
from .pattern_errors import OURS, PatternErrors
from .pattern_selection import frames_an_indenter, part_of
from .press_jobs import TrackingJob, cost_s, follow
from .registry import StudyRequest, share_of, virtual_rig
from .scene import RIG, PressScene
from .search_candidates import (
    MAX_PX,
    MIN_BRIDGED_MM,
    MIN_COVERAGE,
    MIN_DOTS,
    MIN_PX,
    PAPER,
    ProbeJob,
    candidates,
    confirmed,
    errors_by_size,
    finalists,
    headlines,
    name_of,
    probe,
    ranked,
    shortened,
    thinned,
)

PROTOCOL = "pattern-search"
MIN_CANDIDATES = 8
MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""2500 px across the view take minutes a pattern; 300 px are too few to track in."""
PROBE_S = 3.0
"""A candidate's cost on one core."""
LEFT_OUT = (
    Note("grey patterns", "a printer makes them of one ink, which the model of three does not "
            "hold; and the tracker's second witness is colour"),
    Note("marker dots", "they are features themselves and would flatter the error"),
    Note("the lens", "the view is a pinhole's: the search is for a scale in mm a pixel"),
    Note("the search's own gel", "its drag is a known motion: nothing is solved for it"),
)  # fmt: skip


def run(asked: StudyRequest) -> StudyResult:
    """Search, then confirm. Raises InputError for a rig or option that cannot be, RunFailed."""
    scale, rig = share_of(asked.scale), asked.rig or RIG
    config, sensor = bench_of(rig, asked.more.get("dpi"), asked.more.get("mm_per_px"))
    mm_per_dot = MM_PER_INCH / config.virtual.printer.dpi
    whole = candidates(mm_per_dot, sensor.optics.mm_per_px)
    shipped = name_of(load_recipe())
    among = thinned(whole, max(MIN_CANDIDATES, round(scale * len(whole))), (PAPER, shipped))
    whole_protocol, source = load_protocol(PROTOCOL)
    protocol = shortened(whole_protocol, scale)
    of = PressScene({PROTOCOL: protocol}, config, rig, source, sensor, asked.seed)
    searches = [seed_of(asked.seed, f"search {k}") for k in range(max(1, round(2 * scale)))]
    probes = [
        [GridJob(f"{name}, search {k}", probe, ProbeJob(config, sensor, _drawn(recipe, s), s),
                 PROBE_S)
         for k, s in enumerate(searches, start=1)]
        for name, recipe in among.items()
    ]  # fmt: skip
    there = asked.solve([job for own in probes for job in own]).found
    seen = {name: [there[job.name] for job in own if job.name in there]
            for name, own in zip(among, probes, strict=True)}  # fmt: skip
    frame = ranked(seen, among)
    best = finalists(frame, max(2, round(4 * scale)))
    chosen = list(dict.fromkeys([*best, PAPER, *(name for name in (shipped,) if name in among)]))
    of.solve_gels(asked)
    seeds = [seed_of(asked.seed, f"held-out seed {k}") for k in range(max(2, round(5 * scale)))]
    jobs = [
        [
            replace(of, seed=seed).job(
                f"{press}, held out {k}", PROTOCOL, press, follow, TrackingJob,
                cost_s(frames_an_indenter(protocol), len(chosen)), methods=(OURS,),
                patterns={name: _drawn(among[name], seed) for name in chosen},
            )
            for press in of.presses(PROTOCOL)
        ]
        for k, seed in enumerate(seeds, start=1)
    ]  # fmt: skip
    there = asked.solve([job for own in jobs for job in own]).found
    errors = PatternErrors((), [  # of each seed that was done whole
        replace(cell, indenter=f"held out {k}")
        for k, own in enumerate(jobs, start=1) if all(job.name in there for job in own)
        for job in own
        for cell in there[job.name]["cells"]
    ])  # fmt: skip
    gel_table = confirmed(errors, chosen)
    winner = next((name for name in gel_table["pattern"] if name in best), None)
    if winner is None:
        raise RunFailed("pattern-search: no finalist could be tracked on the gel")
    recipe = _drawn(among[winner], DEFAULT_SEED).model_dump(mode="json", exclude_none=True)
    heads, bench = headlines(errors, best, winner), words_of(config, sensor)
    px = recipe["patch_mm"] / sensor.optics.mm_per_px
    dots = recipe["patch_mm"] / mm_per_dot
    about = [
        f"The best of {len(among)} patterns for this printer and camera, simulated:",
        f"{bench['printer']};",
        f"{bench['camera']}.",
        *(one.sentence for one in heads if one.told),
        "Any seed will do.",
    ]
    return StudyResult(
        study=PROTOCOL,
        title="The best pattern for a printer and a camera",
        simulated=True,
        seed=asked.seed,
        scale=asked.scale,
        answer=(f"Print {winner}: patches of {px:.1f} camera pixels and {dots:.1f} printer dots.",),
        headlines=heads,
        tables=(
            ReportTable("confirmed", "Confirmed on the finite-strain gel. Means over "
                        f"{len(seeds)} seeds that the search has not seen.", gel_table),
            ReportTable("candidates", f"The candidates. Means over {len(searches)} seeds, best "
                        "first; of the longest step between frames that is bridged the least.",
                        frame.drop(columns=["law", "patch_mm"])),
        ),
        figures=(
            ReportFigure(
                "errors",
                "Mean error by the size of a patch: of each candidate on the search's drag (dots, "
                "by law), and of those confirmed on the finite-strain gel with 95 % intervals over "
                "the seeds (squares); simulated.",
                partial(errors_by_size, frame, gel_table, among),
            ),
        ),
        settings={
            **bench,
            "candidates": f"{len(among)}, of at least {MIN_DOTS:g} printer dots and {MIN_PX:g} to "
            f"{MAX_PX:g} camera pixels a patch (the paper's in any case)",
            "to be a finalist": f"the tracker is confident on {100 * MIN_COVERAGE:.0f} % of the "
            f"moving pixels and bridges steps of {MIN_BRIDGED_MM:.1f} mm; one of each law and size",
            "confirmed on": f"{part_of(whole_protocol, protocol).words}, finite-strain gel of the "
            f"rig {rig!r}",
            "friction": f"{protocol.specimen.friction:g}",
            "seeds": f"{len(searches)} of the search, {len(seeds)} held out: pattern, print and "
            "noise are drawn anew with each",
        },
        notes=(
            "Printer and camera are models with assumed parameters, not measured ones: print the "
            "best few on one sheet and run `study run pattern-selection` on your bench before you "
            "commit.",
            *dict.fromkeys(f"{cell.pattern} could not be tracked on the gel: {why}"
                           for cell in errors.cells for why in cell.left_out),
        ),
        left_out=LEFT_OUT,
        files={"best-pattern.toml": toml_text(
            {k: v for k, v in recipe.items() if (k, v) != ("channels", 3)}, about)},
        more={"best": {"pattern": winner, "recipe": recipe}},
    )  # fmt: skip


def _drawn(recipe: PatternRecipe, seed: int) -> PatternRecipe:
    """A recipe of another seed."""
    return recipe.model_copy(update={"seed": seed})


def bench_of(
    rig: str, dpi: int | None = None, mm_per_px: float | None = None
) -> tuple[VirtualConfig, SensorDimensions]:
    """A virtual rig, a pinhole without a lens, and the sensor before it.

    dpi: of the printer, mm_per_px: of the camera, None for the rig's and the sensor's. Sides of the
    image are even, for the mosaic. Raises InputError for a rig that is not virtual, or a value out
    of range.
    """
    sensor, config = SensorDimensions(), virtual_rig(rig)[0]
    scale = sensor.optics.mm_per_px if mm_per_px is None else mm_per_px
    if not MIN_MM_PER_PX <= scale <= MAX_MM_PER_PX:  # NaN fails too
        raise InputError(
            f"pattern-search: mm_per_px: {scale:g}; {MIN_MM_PER_PX} to {MAX_MM_PER_PX} mm "
            "of the face a pixel can be simulated"
        )
    width, height = (2 * math.floor(mm / scale / 2 + 1e-9) for mm in sensor.optics.view_mm)
    optics = replace(sensor.optics, mm_per_px=scale, image_width_px=width, image_height_px=height)
    printer = config.virtual.printer
    if dpi is not None:
        printer = validate(Printer, asdict(printer) | {"dpi": dpi}, "pattern-search")
    simulator = config.virtual.model_copy(update={"lens": None, "printer": printer})
    config = config.model_copy(update={"virtual": simulator, "camera": None})
    return config, replace(sensor, optics=optics)


def words_of(config: VirtualConfig, sensor: SensorDimensions) -> dict[str, str]:
    """Printer and camera for people."""
    p, s = config.virtual.printer, config.virtual.camera
    return {
        "printer": f"{p.dpi} dpi, {p.levels} levels an ink, spread {p.spread_um:g} µm, inks "
        f"misplaced by {p.misregistration_um:g} µm (standard deviation)",
        "camera": f"{sensor.optics.mm_per_px:g} mm a pixel, blur {s.blur_px:g} px, full well "
        f"{s.full_well_electrons:g} electrons, read noise {s.read_noise_electrons:g}, "
        f"shading {s.shading:g}, Bayer mosaic",
    }
