"""One press by felupe: `.venv-peers/bin/python benchmarks/peers/felupe_press.py CASE.npz OUT`.

Writes OUT.npz and OUT.json; see README.md for what is in them. felupe gives element, constitutive
law, assembly and Newton's method; only the sphere and the volumetric law are added here, and a
direct solver for symmetric matrices is handed to it.
"""

import json
import os
import sys
import time

import felupe as fem
import numpy as np
import pypardiso
import scipy.sparse

LAW = ("mu_mpa", "lambda_mpa", "local_mpa")


class FourthOrder(fem.NeoHookeCompressible):
    """felupe's neo-Hooke and b/4 ln(J)^4 at every point."""

    def __init__(self, mu, local):
        super().__init__(mu=mu)
        self.local = local

    def _gradient(self, x):
        stress, statevars = super()._gradient(x)
        j = fem.math.det(x[0])
        cofactor = fem.math.transpose(fem.math.inv(x[0], j))
        stress += self.local * np.log(j) ** 3 * cofactor
        return [stress, statevars]

    def _hessian(self, x):
        (tangent,) = super()._hessian(x)
        j = fem.math.det(x[0])
        cofactor = fem.math.transpose(fem.math.inv(x[0], j))
        log = np.log(j)
        tangent = tangent + (3 * self.local * log**2) * fem.math.dya(cofactor, cofactor)
        tangent -= (self.local * log**3) * fem.math.cdya_il(cofactor, cofactor)
        return [tangent]


class MeanDilatation(fem.SolidBodyNearlyIncompressible):
    """felupe's three-field body, U = lambda/2 ln(J)^2 - b/4 ln(J)^4 in place of its K/2 (J - 1)^2.

    Volume ratio and pressure stay fields of the cells, carried on by the linearised step.
    """

    def __init__(self, field, mu, lam, local):
        self.lam, self.local = lam, local
        umat = FourthOrder(mu, local) if local else fem.NeoHookeCompressible(mu=mu)
        super().__init__(umat, field, bulk=lam)
        self.assemble.vector, self.assemble.matrix = self._unbalanced, self._stiffness

    def _extract(self, field, parallel=False):
        state = self.results.state
        rate = state.integrate_shape_function_gradient(parallel=parallel)
        step = (field[0].values - state.u)[field.region.mesh.cells]
        state.J[:] = (np.einsum("cai,aic->c", step, rate) + state.volume()) / self.V
        # The linearised volume may vanish in a long step; the trial is then refused elsewhere.
        np.maximum(state.J, 0.05, out=state.J)
        log = np.log(state.J)
        state.p[:] = (self.lam * log - self.local * log**3) / state.J
        state.u[:] = field[0].values
        self.field = field
        state.F = field.extract(out=self.results.kinematics)
        return state.F

    def _unbalanced(self, field=None, parallel=False, **_):
        stress = self._gradient(field, parallel=parallel)
        state = self.results.state
        form = fem.IntegralForm(stress, v=self.field, dV=self.field.region.dV)
        values = form.integrate(parallel=parallel)
        rate = state.integrate_shape_function_gradient(parallel=parallel)
        values[0] = values[0] + rate * (self._stiffening() * (state.volume() / self.V - state.J))
        self.results.force = form.assemble(values=values)
        return self.results.force

    def _stiffness(self, field=None, parallel=False, **_):
        elasticity = self._hessian(field, parallel=parallel)
        rate = self.results.state.integrate_shape_function_gradient(parallel=parallel)
        form = fem.IntegralForm(elasticity, v=self.field, u=self.field, dV=self.field.region.dV)
        values = form.integrate(parallel=parallel)
        scaled = rate * (self._stiffening() / self.V)
        values[0] = values[0] + np.einsum("aic,bjc->aibjc", scaled, rate)
        self.results.stiffness = form.assemble(values=values)
        return self.results.stiffness

    def _stiffening(self):
        j = self.results.state.J
        log = np.log(j)
        slope = self.lam * log - self.local * log**3
        return (self.lam - 3 * self.local * log**2 - slope) / j**2


class Sphere:
    """A smoothed penalty on the distance from a rigid sphere at 2 x 2 points a face."""

    def __init__(self, mesh, faces, stiffness, hardening, straight, width, shallow, radius):
        on_face = np.zeros(mesh.npoints, dtype=bool)
        on_face[faces] = True
        region = fem.RegionHexahedronBoundary(mesh, mask=on_face)
        self.field = fem.FieldContainer([fem.Field(region, dim=3)])
        place = {tuple(sorted(face)): i for i, face in enumerate(faces)}
        order = [place[tuple(sorted(face))] for face in region.mesh.cells_faces]
        assert sorted(order) == list(range(len(faces)))
        self.stiffness, self.hardening = stiffness[order], hardening[order]
        self.straight, self.width = straight[order], width[order]
        self.shallow, self.radius = shallow, radius
        self.resting = fem.Field(region, dim=3, values=mesh.points).interpolate()
        self.centre = np.zeros(3)
        self.assemble = fem.mechanics._helpers.Assemble(vector=self._vector, matrix=self._matrix)
        self.results = fem.mechanics._helpers.Results()

    def move(self, tip):
        self.tip = tip
        self.centre = np.array([tip[0], tip[1], self.radius - tip[2]])

    def pressed(self):
        """Distance of the centre (q, c), normal (3, q, c), pressure and its rise (q, c)."""
        away = self.resting + self.field[0].interpolate() - self.centre[:, None, None]
        size = np.linalg.norm(away, axis=0)
        inside = self.radius - size
        k, w = self.stiffness, np.clip(self.shallow * self.tip[2], 1e-9, self.width)
        s = np.clip(inside + w / 2, 0, w)
        ramp = s**2 / (2 * w) + np.maximum(inside - w / 2, 0)
        curved = np.minimum(ramp, self.straight)
        more = self.hardening * curved**2
        steepest = 1 + 3 * self.hardening * self.straight**2
        pressure = k * (curved * (1 + more) + steepest * (ramp - curved))
        return size, away / size, pressure, k * s / w * (1 + 3 * more)

    def _form(self, fun, **more):
        dv = self.field.region.dV
        return fem.IntegralForm([fun], v=self.field, dV=dv, grad_v=[False], **more)

    def _vector(self, field=None, parallel=False, **_):
        if field is not None:
            self.field = field
        _, normal, pressure, _ = self.pressed()
        self.results.force = self._form(-pressure * normal).assemble(parallel=parallel)
        return self.results.force

    def _matrix(self, field=None, parallel=False, **_):
        if field is not None:
            self.field = field
        size, normal, pressure, rise = self.pressed()
        nn = normal[:, None] * normal[None]
        block = rise * nn - pressure / size * (np.eye(3)[..., None, None] - nn)
        form = self._form(block, u=self.field, grad_u=[False])
        self.results.stiffness = form.assemble(parallel=parallel)
        return self.results.stiffness


class SymmetricSolver:
    """Pardiso for real symmetric indefinite matrices; its ordering is kept with the pattern."""

    def __init__(self):
        self.mkl = pypardiso.PyPardisoSolver(mtype=-2)
        # As in deltact_fab.physics.gel.finite.linear, so that neither side has the better settings.
        for place, value in {1: 1, 2: 2, 8: 2, 10: 8, 21: 1, 24: 1}.items():
            self.mkl.set_iparm(place, value)
        self.upper, self.keys, self.seconds, self.orderings = None, None, 0.0, 0

    def __call__(self, matrix, right):
        started = time.perf_counter()
        same = self._take(matrix)
        right = np.ascontiguousarray(right, dtype=float).ravel()
        # The public call compares and copies all entries, and repeats the ordering.
        for phase in (22 if same else 12, 33):
            self.mkl.set_phase(phase)
            x = self.mkl._call_pardiso(self.upper, right)
        self.seconds += time.perf_counter() - started
        return x

    def _take(self, matrix):
        """Put the upper triangle into the pattern kept so far; False where that has to grow."""
        upper = scipy.sparse.triu(matrix, format="csr")
        upper.sort_indices()
        n = upper.shape[0]
        # Sums of sparse matrices lose entries that happen to vanish.
        keys = np.repeat(np.arange(n), np.diff(upper.indptr)) * n + upper.indices
        if self.keys is not None:
            at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
            if np.array_equal(self.keys[at], keys):
                self.upper.data[:] = 0
                self.upper.data[at] = upper.data
                return True
            self.mkl.free_memory(everything=True)
        all_keys = keys if self.keys is None else np.union1d(self.keys, keys)
        data = np.zeros(len(all_keys))
        data[np.searchsorted(all_keys, keys)] = upper.data
        start = np.searchsorted(all_keys // n, np.arange(n + 1)).astype(np.int32)
        columns = (all_keys % n).astype(np.int32)
        self.upper = scipy.sparse.csr_matrix((data, columns, start), shape=(n, n))
        self.keys, self.orderings = all_keys, self.orderings + 1
        return False


class Counter(fem.Plugin):
    """Iterations, those of increments given up included."""

    count = 0

    def after_iteration(self, context, state):
        self.count += 1


def solve(case, threads):
    """Arrays of the .npz and scalars of the .json."""
    started = time.perf_counter()
    mesh = fem.Mesh(case["nodes_mm"], case["cells"], "hexahedron")
    field = fem.FieldContainer([fem.Field(fem.RegionHexahedron(mesh), dim=3)])
    bulk = MeanDilatation(field, *(float(case[k]) for k in LAW))
    faces = case["faces"]
    sphere = Sphere(
        mesh, faces, case["stiffness"], case["hardening_per_mm2"], case["straight_mm"],
        case["width_mm"], float(case["shallow"]), float(case["radius_mm"]),
    )  # fmt: skip
    held = np.zeros(mesh.npoints, dtype=bool)
    held[case["base"]] = True
    boundaries = {"base": fem.Boundary(field[0], mask=held)}
    dof0, dof1 = fem.dof.partition(field, boundaries)
    ext0 = fem.dof.apply(field, boundaries, dof0)
    surface = np.unique(faces)
    solver, counter, floor = SymmetricSolver(), Counter(), float(case["floor_n"])
    ready, ready_cpu = time.perf_counter(), time.process_time()

    def check(dx, x, f, xtol, ftol, dof1=None, dof0=None, items=None):
        """As in FinitePress: unbalanced forces over the contact's."""
        contact = np.linalg.norm(sphere.results.force.toarray()[dof1])
        size = np.linalg.norm(f[dof1]) / max(contact, floor)
        return float(np.abs(dx).max()), float(size), bool(size <= ftol)

    def increment(tip):
        """Newton at one position; the accepted unknowns are a copy, put back into the field."""
        sphere.move(tip)
        found = fem.newtonraphson(
            items=[bulk, sphere], dof0=dof0, dof1=dof1, ext0=ext0, solver=solver, check=check,
            tol=float(case["tolerance"]), maxiter=int(case["most_iterations"]), verbose=0,
            plugins=[counter, fem.LinesearchPlugin(residual=False)],
            kwargs={"parallel": threads > 1},
        )  # fmt: skip
        put(found.x[0].values)

    def put(u):
        field[0].values = u.copy()
        for item in (bulk, sphere):
            item.field.link(field)
        bulk.results.state.u[:] = u
        bulk.results.state.F = bulk.results.kinematics = field.extract()

    out = {"force_n": [], "displacement_mm": [], "iterations": [], "seconds": []}
    reason, cuts, before = None, 0, np.array([*case["tips_mm"][0][:2], 0.0])
    for tip in case["tips_mm"]:
        begun, counter.count = time.perf_counter(), 0
        done, part = 0.0, 1.0
        while done < 1:
            kept, goal = field[0].values.copy(), min(1.0, done + part)
            try:
                increment(before + goal * (tip - before))
                done = goal
            except fem.NewtonConvergenceError as why:
                put(kept)
                cuts, part = cuts + 1, part / 2
                if part < 2.0**-6:
                    reason = f"at depth {tip[2]:g} mm: {' '.join(str(why).split())}"
                    break
        if reason:
            break
        before = tip
        out["seconds"].append(time.perf_counter() - begun)
        out["force_n"].append(-sphere.results.force.toarray().reshape(-1, 3).sum(axis=0))
        out["displacement_mm"].append(field[0].values[surface].copy())
        out["iterations"].append(counter.count)
    arrays = {key: np.array(value) for key, value in out.items()}
    arrays["surface"] = surface
    return arrays, {
        "converged": reason is None,
        "reason": reason,
        "cuts": cuts,
        "felupe": fem.__version__,
        "numpy": np.__version__,
        "solver": f"pypardiso {pypardiso.__version__}, mtype -2",
        "threads": threads,
        "unknowns": len(dof1),
        "orderings": solver.orderings,
        "solver_s": solver.seconds,
        "setup_s": ready - started,
        "press_s": time.perf_counter() - ready,
        "press_cpu_s": time.process_time() - ready_cpu,
    }


def main(case_file, out):
    with np.load(case_file) as case:
        arrays, scalars = solve(dict(case), int(os.environ.get("OMP_NUM_THREADS", "1")))
    np.savez(f"{out}.npz", **arrays)
    with open(f"{out}.json", "w", encoding="utf-8") as file:
        json.dump(scalars, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
