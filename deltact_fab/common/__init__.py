"""Shared basics: errors, files, units, the catalogue, the cache, jobs and page templates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .aliases import Array, Field, Image, Note, Point, Point2, Progress
    from .cache import Store, cache_key
    from .catalog import (
        catalogue_names, find_file, toml_literal, toml_text, validate, write_new_file,
    )
    from .checks import Check, Status, graded
    from .configuration import OneOrEach, Table, json_schema_of, resolve_schema
    from .digest import code_digest
    from .discover import collect_entries
    from .errors import (
        DeltactFabError, InputError, MissingLibrary, RunFailed, SensorError, SolverError,
        StageError, Stopped, TimeLimit, did_you_mean, fault_line, require_extra,
    )
    from .files import (
        check_writable, disk_errors, make_folder, sync_folder, whole_file, write_files,
        write_whole,
    )
    from .jobs.batch import count_workers, run_each, run_jobs
    from .jobs.cluster import open_executor
    from .machine_code import compile_loop
    from .reading import parse_json, read_json, read_text, read_toml
    from .templating import format_number, html_table, render_page, require_pages, write_page
    from .units import MM_PER_INCH, format_duration, to_ns
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
