"""Results for people: live measurement, pages, figures and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .live.acceptance import accept_sensor, acceptance_picture, save_acceptance
    from .live.known_step import known_steps
    from .live.open import acceptance_file, open_source
    from .live.outputs import (
        HealthOutput, JsonLines, KeptFolder, MeasurementOutput, MeasurementSummary, PageOutput,
        StatusLine, describe_source, require_new_folder,
    )
    from .live.page import LivePage
    from .live.session import (
        LiveMeasurement, MeasurementSession, measure_source, once, open_session, track_images,
    )
    from .report.figures import (
        INK_COLOUR, PAPER_COLOUR, SERIES_COLOURS, blank_figure, figure_bytes, legend_below,
        log_ticks, paper_line,
    )
    from .report.first_light import pairs
    from .report.index_page import is_index_above, write_index
    from .report.numerics_page import write_numerics_page, write_rehearsal_page
    from .report.page import write_imported_page, write_run_page
    from .report.patterns_page import write_patterns_page
    from .report.result import (
        Claim, ClaimReading, GEL_FLAGS, Headline, ReportFigure, ReportTable, StudyResult,
        table_records,
    )
    from .report.run_figures import plot_error_by_time, plot_predicted_force
    from .report.shape_figures import plot_depth_against_truth, plot_distribution, plot_gallery
    from .report.study_page import require_ready_study, write_study_figures, write_study_page
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
