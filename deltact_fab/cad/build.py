"""One part to one gated solid: rules first, then the kernel, then the gate."""

from __future__ import annotations

import importlib
from typing import Any

from . import rules
from .checks import Expected, Measured, gate
from .dimensions import Design
from .kernel import guarded
from .registry import Part


def build_part(part: Part, design: Design) -> tuple[Any, Measured]:
    """Build one part and gate it: a cadquery Solid and its measures.

    Raises InputError when a dimension breaks an inequality, before the kernel runs; RunFailed
    naming part and parameters when the kernel fails or returns something else.
    """
    wanted = expected(part, design)
    module, function, source = _maker(part, design)
    with guarded(part.name, wanted.parameters):
        return gate(part.name, getattr(module, function)(source), wanted)


def expected(part: Part, design: Design) -> Expected:
    """What the part must be, without the kernel. Raises InputError where a rule is broken."""
    if part.indenter is None:
        rules.enforce(rules.of_design(design))
    module, function, source = _maker(part, design)
    # `build_testing` is held against `expect_testing`.
    expect = getattr(module, function.replace("build", "expect", 1))
    wanted = expect(source)
    assert isinstance(wanted, Expected)
    return wanted


def _maker(part: Part, design: Design) -> tuple[Any, str, Any]:
    """Module, name of its builder, and the dimensions that it takes."""
    module_name, _, function = part.builder.partition(":")
    source = design if part.indenter is None else part.indenter
    return importlib.import_module(module_name), function, source
