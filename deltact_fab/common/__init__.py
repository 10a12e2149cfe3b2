"""What every wing uses: errors, files, units, the catalogue, the cache, jobs and page templates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .aliases import (
        Array, Field, Float, Image, Index, Mask, Note, Point, Point2, Points, Progress, Vector,
        WARNING,
    )
    from .cache import (
        cache_folder, cache_key, cached_file, plain_data, read_cached, trim_cache, write_cached,
    )
    from .catalog import (
        CATALOGUE_KINDS, CATALOGUE_LISTS, catalogue_names, design_names, find_file, read_toml,
        toml_literal, toml_text, validate, write_new_file,
    )
    from .checks import Check, Status, graded, passes, worst
    from .configuration import (
        BY_NAME, ONE_OF, Place, Table, json_schema_of, resolve_schema, same_as,
    )
    from .digest import code_digest
    from .discover import entries, modules_in
    from .errors import (
        DeltactFabError, INTERRUPTED, InputError, MissingLibrary, RunFailed, SensorError,
        SolverError, StageError, Stopped, TimeLimit, did_you_mean, fault_line,
    )
    from .extras import EXTRAS, require_extra
    from .files import (
        DISK, check_folder, check_place, disk_errors, make_folder, making_files, sync_folder,
        whole_file, write_together, write_whole,
    )
    from .jobs.batch import CannotGoOn, JobOutcome, jobs_at_a_time, run_each, run_jobs
    from .jobs.cluster import open_executor
    from .jobs.local import Local, processors
    from .machine_code import compile_loop
    from .reading import is_file, parse_json, read_json, read_text
    from .templating import (
        finding, format_fixed, format_number, html_table, label, page_verdict, render_page,
        require_pages, save_page, warning_findings,
    )
    from .units import (
        DIGITS, MM_PER_INCH, NS_PER_S, POINTS_PER_MM, format_digits, format_duration,
        stream_number, to_ns,
    )
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
