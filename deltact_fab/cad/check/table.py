"""The checks by name: what runs, what it looks at, and what it promises when it cannot run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from .built import BuiltDesign
from .row import Row, from_plain, to_plain


@dataclass(frozen=True)
class CheckKind:
    """One kind of check; `part` and `limit` stand in the row that says it was not run."""

    name: str
    part: str
    limit: str
    rows: Callable[[BuiltDesign], Iterator[Row]]

    def found(self, built: BuiltDesign) -> list[Row]:
        """Its rows, or those found earlier for a design that gives the same ones."""
        return from_plain(built.result(self.name, lambda: to_plain(self.rows(built))))

    def not_run(self, why: str) -> Row:
        """The failing row of a check that could not be made."""
        return Row(self.name, self.part, f"not run: {why}", self.limit, False)
