"""Everything that is made: parts as solids, pattern stickers, sheets, drawings and the guide."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .cad.assembly import assemble_bench, assemble_sensor
    from .cad.build import build_named_part
    from .cad.check.arithmetic import EVEN_LIGHT_SHARE, illuminance
    from .cad.check.row import shorten_key
    from .cad.check.verdict import judge_design
    from .cad.design import load_cameras, load_design
    from .cad.dimensions import Design
    from .cad.export import export_parts
    from .cad.fabrication.bom import bom_lines
    from .cad.fabrication.readings import fit_design
    from .cad.feasibility import check_feasible
    from .cad.intent import Wish
    from .cad.parts.light_holder import plate_bending_room
    from .cad.registry import find_part, list_parts, select_parts
    from .cad.solution import solve_wish
    from .cad.stiffness import press_plate
    from .guide import write_guide
    from .patterns.code import read_code
    from .patterns.in_view import FaceFindings, PrintInView, measure_fall
    from .patterns.laws import PATTERN_LAWS
    from .patterns.laws.algorithm1 import Algorithm1
    from .patterns.metadata import read_recipe
    from .patterns.quality.measure import measure_quality
    from .patterns.raster import make_pattern, pattern_albedo
    from .patterns.recipe import DEFAULT_SEED, PatternRecipe, choose_recipe, load_recipe
    from .patterns.series import PatternSeries, SeriesEntry, list_series, write_series
    from .patterns.sheet.job import write_sheet
    from .patterns.verify import load_printer, verify_print
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
