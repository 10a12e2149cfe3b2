"""The one executor of the package: jobs side by side, on this machine or on a Dask cluster.

Everything is written against concurrent.futures.Executor. each.py hands jobs to one and collects,
local.py is processes here, cluster.py is an existing Dask cluster, word.py is what a job says while
it runs.
"""

from .each import CannotGoOn, Ended, Progress, arrivals, each, run
from .executors import executor, width
from .local import THREAD_VARIABLES, processors
from .word import tell

__all__ = [
    "THREAD_VARIABLES",
    "CannotGoOn",
    "Ended",
    "Progress",
    "arrivals",
    "each",
    "executor",
    "processors",
    "run",
    "tell",
    "width",
]
