"""Symmetric sparse solvers behind one small interface: factorise a triangle, then solve.

Pardiso (extra `fast`) also returns the inertia; SuperLU in symmetric mode needs no extra, but
gigabytes of memory above 30 000 rows.
"""

from __future__ import annotations

import os
import sys
import weakref
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from deltact_fab.common import Field, InputError, MissingLibrary, SolverError, require_extra

SolverName = Literal["auto", "pardiso", "superlu"]

# Definition of the MKL manual (iparm, from one): own values, METIS, two refinements, pivots
# raised to 1e-8 of the norm, 1 x 1 and 2 x 2 pivots, the two-level factorisation (1.5 times as
# fast on one core).
_PARDISO_PARAMETERS = {1: 1, 2: 2, 8: 0, 10: 8, 21: 1, 24: 1}


class Pardiso:
    """MKL's Pardiso, real symmetric indefinite (type -2). The ordering is computed once."""

    name = "pardiso"

    def __init__(self) -> None:
        require_extra("fast", "the solver pardiso", "pypardiso")
        # Without it each solver searches the whole environment, which takes half a second.
        for name in ("lib/libmkl_rt*", "Library/bin/mkl_rt*"):
            for library in Path(sys.prefix).glob(name):
                os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
        import pypardiso

        self._failed = pypardiso.pardiso_wrapper.PyPardisoError
        self._mkl: Any = pypardiso.PyPardisoSolver(mtype=-2)
        for place, value in _PARDISO_PARAMETERS.items():
            self._mkl.set_iparm(place, value)
        self._upper: sp.csr_matrix | None = None
        self.negative: int | None = None

    def factorise(self, upper: sp.csr_matrix) -> None:
        """Factorise numerically; symbolically only when the pattern is new."""
        same_pattern = self._upper is not None and self._upper.nnz == upper.nnz
        same_pattern = same_pattern and self._upper.indices is upper.indices  # type: ignore[union-attr]
        if self._upper is not None and not same_pattern:
            self._mkl.free_memory(everything=True)
        if self._upper is None:
            # Factors live outside Python; at exit they must be freed before the library.
            weakref.finalize(self, self._mkl.free_memory, everything=True)
        self._upper = upper
        self._call(22 if same_pattern else 12, np.zeros(upper.shape[0]))
        # Input parameters 22 and 23 of the manual, counted from one.
        self.negative = int(self._mkl.get_iparm(23))

    def solve(self, right: Field) -> Field:
        return self._call(33, np.ascontiguousarray(right, dtype=np.float64))

    def _call(self, phase: int, right: Field) -> Field:
        # The public `solve` compares all entries with its copy on every call, and its `factorize`
        # repeats the ordering: together as slow as the factorisation itself.
        self._mkl.set_phase(phase)
        try:
            return self._mkl._call_pardiso(self._upper, right)
        except self._failed as error:
            raise SolverError(f"linear solver: pardiso failed in phase {phase}: {error}") from error


class SuperLU:
    """scipy's SuperLU with a symmetric ordering and diagonal pivots."""

    name = "superlu"

    def __init__(self) -> None:
        self._factor: Any = None
        self.negative: int | None = None

    def factorise(self, upper: sp.csr_matrix) -> None:
        """Factorise both triangles; the ordering is repeated each time."""
        try:
            self._factor = spla.splu(
                _full(upper).tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise SolverError(f"linear solver: SuperLU: {error}") from error
        # With pivots left on the diagonal their signs are the inertia (Sylvester).
        same = np.array_equal(self._factor.perm_r, self._factor.perm_c)
        self.negative = int((self._factor.U.diagonal() < 0).sum()) if same else None

    def solve(self, right: Field) -> Field:
        return self._factor.solve(right)


Solver = Pardiso | SuperLU
"""Solver of K x = b for one sparsity pattern and changing entries; `factorise` takes the upper
triangle with its diagonal. negative: number of negative eigenvalues of the last factor, None where
unknown."""
LINEAR_SOLVERS: dict[str, type[Solver]] = {"pardiso": Pardiso, "superlu": SuperLU}


def make_solver(name: SolverName = "auto") -> Solver:
    """Make Pardiso if installed, else SuperLU. Raises InputError for an unknown name."""
    if name == "auto":
        try:
            return Pardiso()
        except MissingLibrary:
            return SuperLU()
    if name not in LINEAR_SOLVERS:
        raise InputError(f"linear solver {name!r}: valid: auto, {', '.join(LINEAR_SOLVERS)}")
    return LINEAR_SOLVERS[name]()


def _full(upper: sp.csr_matrix) -> sp.csr_matrix:
    return (upper + sp.triu(upper, k=1).T).tocsr()
