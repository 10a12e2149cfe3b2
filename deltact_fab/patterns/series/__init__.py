"""The paper's two selections as recipes, one print job, figures and views."""

from .job import SeriesEntry, SeriesReport, recipes, write

__all__ = ["SeriesEntry", "SeriesReport", "recipes", "write"]
