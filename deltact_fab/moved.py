"""Module paths that the documents of 0.3 taught: they lead on, with a warning, until 0.5."""

from __future__ import annotations

import ast
import inspect
import sys
import warnings
from functools import partial
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType

from .door import handed_on

# By the wing that they move into. Read for a path only where no file has it any more.
TAUGHT = {
    "common": ("aliases", "errors"),
    "sensor": ("elasticity", "optics", "shapes", "shapes.indenter"),
    "physics": ("gel.press",),
    "fabricate": ("cad.assembly", "cad.build", "cad.design", "cad.export", "cad.feasibility",
                  "cad.registry", "patterns", "patterns.quality.measure"),
    "bench": ("protocols.plan", "record", "rig.config", "rig.interface", "rig.tables",
              "rig.tool.feeler", "rig.tool.session", "rig.tool.tooling", "rig.tool.touch"),
    "estimate": ("analysis.force", "analysis.shape", "analysis.tracking_error"),
    "simulate": ("experiment",),
}  # fmt: skip


class MovedModule(Loader):
    """Loads a taught module, or a package above one."""

    def exec_module(self, module: ModuleType) -> None:
        """Hand on the names of the moved module, after one warning."""
        top, _, old = module.__name__.partition(".")
        public = handed_on(ast.parse(inspect.getsource(sys.modules[top])), top)
        for wing in (wing for wing, taught in TAUGHT.items() if old in taught):
            place = f"{top}.{wing}.{old}"
            names = [f"dt.{name}" for name, (home, _) in public.items()
                     if home == f"{top}.{wing}" or f"{home}.".startswith(f"{place}.")]  # fmt: skip
            instead = f"`import {top} as dt` has {', '.join(names) or 'nothing in its place'}"
            warnings.warn(f"{module.__name__} goes in 0.5: {instead}", FutureWarning, stacklevel=2)
            vars(module)["__getattr__"] = partial(getattr, import_module(place))


def spec_of(name: str) -> ModuleSpec | None:
    """Spec of a module at its old path; None for any other."""
    old = f"{name.partition('.')[2]}."
    if any(f"{path}.".startswith(old) for taught in TAUGHT.values() for path in taught):
        return ModuleSpec(name, MovedModule(), is_package=True)
    return None
