"""Results for people: live measurement, pages, figures and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .live.acceptance import accept_sensor
    from .live.known_step import check_known_step
    from .live.open import open_source
    from .live.outputs import deliver_results
    from .live.session import LiveMeasurement, measure_source, open_session, track_images
    from .report.figures import (
        create_figure, draw_legend, draw_paper_line, figure_bytes, set_log_scale,
    )
    from .report.first_light import render_examples
    from .report.index_page import is_index_above, write_index
    from .report.numerics_page import write_numerics_page, write_rehearsal_page
    from .report.page import write_imported_page, write_run_page
    from .report.patterns_page import write_patterns_page
    from .report.result import Claim, Headline, ReportFigure, ReportTable, StudyResult
    from .report.run_figures import plot_error_by_time, plot_predicted_force
    from .report.shape_figures import plot_depth_against_truth, plot_distribution, plot_gallery
    from .report.study_page import require_ready_study, write_study_figures, write_study_page
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
