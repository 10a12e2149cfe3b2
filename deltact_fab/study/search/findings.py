"""What the two grids of a pattern search gave, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ...catalog import as_toml
from ...protocols.plan import Protocol
from ..intervals import Interval
from .candidates import Candidate
from .imager import PatternImager
from .ranking import Pair
from .scale import Size
from .search import order
from .verdict import DEFAULT, FARNEBACK, ConfirmedPattern, best_of, confirmed, gain

if TYPE_CHECKING:
    import pandas as pd

UM = 1000.0
RECIPE_SEED = 7
MIN_ORDERED = 6


@dataclass(frozen=True)
class Findings:
    """All that the two grids gave.

    frame: of candidates. order, sure_order, lost_order: of predictors, by the drag's error, by that
    of the pixels that the tracker is sure of, and by the share that it is not sure of. presses: by
    name. confirmations: by held-out seed, what `confirm` gave of each press.
    """

    bench: PatternImager
    rig: str
    seed: int
    scale: float | None
    size: Size
    protocol: Protocol
    among: tuple[Candidate, ...]
    frame: pd.DataFrame
    order: pd.DataFrame
    sure_order: pd.DataFrame
    lost_order: pd.DataFrame
    pair: Pair | None
    finalists: tuple[str, ...]
    paper: str
    shipped: str | None
    confirmed_names: tuple[str, ...]
    presses: tuple[str, ...]
    confirmations: tuple[Sequence[Mapping[str, Any]], ...]
    missing: tuple[str, ...]

    @cached_property
    def ours(self) -> list[ConfirmedPattern]:
        """With the default tracker, best first."""
        return confirmed(self.confirmations, self.confirmed_names, DEFAULT)[0]

    @cached_property
    def refused(self) -> dict[str, str]:
        """Patterns that could not be tracked on the gel, and why."""
        return confirmed(self.confirmations, self.confirmed_names, DEFAULT)[1]

    @cached_property
    def farneback(self) -> list[ConfirmedPattern]:
        """With the paper's own tracker."""
        return confirmed(self.confirmations, self.confirmed_names, FARNEBACK)[0]

    @cached_property
    def best(self) -> ConfirmedPattern:
        """The pattern to print. Raises RunFailed where no finalist was tracked."""
        return best_of(self.ours, self.finalists)

    @cached_property
    def gain(self) -> Interval | None:
        """Its error over that of the paper's pattern."""
        return gain(self.ours, self.finalists, self.paper)

    @cached_property
    def confirmed_order(self) -> pd.DataFrame | None:
        """Of predictors, by the error on the gel; None where too few patterns were confirmed."""
        errors = {one.pattern: one.error.value for one in self.ours}
        part = self.frame.assign(confirmed_mm=self.frame["pattern"].map(errors))
        return order(part, "confirmed_mm") if len(errors) >= MIN_ORDERED else None

    def of(self, found: list[ConfirmedPattern], name: str | None) -> ConfirmedPattern | None:
        """A confirmed pattern by its name."""
        return next((one for one in found if one.pattern == name), None)

    def row(self, name: str) -> dict[str, Any]:
        """A candidate's row of the table of the search."""
        row = self.frame[self.frame["pattern"] == name].iloc[0]
        return {str(column): value for column, value in row.items()}


def recipe_text(found: Findings) -> str:
    """The winner as a recipe file, with the figures that speak for it."""
    candidate = next(c for c in found.among if c.name == found.best.pattern)
    recipe = candidate.recipe(RECIPE_SEED).model_dump(mode="json", exclude_none=True)
    words = found.bench.words()
    about = [
        f"The best of {len(found.among)} patterns for this printer and camera, simulated:",
        f"{words['printer']};",
        f"{words['camera']}.",
        f"Mean error of the moving pixels {UM * found.best.error.value:.2g} µm"
        + (f", {found.gain.value:.2f} of that of the paper's d 0.075, r 0.6" if found.gain else "")
        + f" ({found.best.error.over}).",
        "Its seed may be any.",
    ]
    return as_toml({k: v for k, v in recipe.items() if (k, v) != ("channels", 3)}, about)
