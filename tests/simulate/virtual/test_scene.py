"""The gel follows the path that the controller drives, and solves only what is observed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from deltact_fab.physics.gel.level import GelContact, Reach, State, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.knots import Increments, KnotPose, ObservedChannels
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.physics.gel.path.solver import PathSolver
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.presses import PlannedPress
from deltact_fab.simulate.virtual.scene import GelScene, LatticeCrop

FRAME = StageFrame((-60.0, -60.0, -40.0))
E_MPA = 0.56
REACH = Reach((-3.0, 3.0), (-3.0, 3.0), 1.2)


def linear(modulus_mpa: float) -> GelContact:
    scene = SkinDimensions(), GelMaterial(modulus_mpa), parse_indenter("sphere:10")
    return open_contact(*scene, select_level(*scene, REACH, level="linear", spacing_mm=0.5), 0.5)


UNIT = linear(1.0)  # what a press is solved with
ALL = ObservedChannels("all")


class Bench:
    """A homed controller, driven by raw lines, and the scene that watches it."""

    def __init__(self, press_mm: float = 0.1, shear_mm: float = 0.25, drawn: bool = True) -> None:
        self.clock = VirtualClock()
        self.controller = GrblController(None, self.clock)
        self.clock.sleep_s(2.0)
        self.line("$H")
        self.clock.sleep_s(60.0)
        crop = LatticeCrop(UNIT.x_mm, UNIT.y_mm, (12.0, 10.0)) if drawn else None
        self.presses: list[PlannedPress] = []
        self.scene = GelScene(
            self.controller, self.clock, FRAME, Increments(press_mm, shear_mm), self.press, crop,
            E_MPA,
        )  # fmt: skip
        self.contact = linear(E_MPA)
        self.scene.mount("sphere:10")
        self.scene.begin("sphere-10/p1")

    def press(self, name: str, indenter: str, at_mm: tuple[float, float]) -> PlannedPress:
        assert (name, indenter) == ("sphere-10/p1", "sphere:10")
        self.presses.append(PlannedPress(PathSolver(lambda: UNIT, observed=ALL)))
        return self.presses[-1]

    @property
    def solves(self) -> int:
        return sum(p.solver.solves for p in self.presses)

    def force_n(self) -> list[float]:
        """On the sensor, now."""
        return self.scene.wrenches(np.array([self.clock.now_ns()]))[0, :3].tolist()

    def line(self, text: str) -> None:
        self.controller.write(text.encode() + b"\n")

    def jog(self, x: float, y: float, z: float, feed: float) -> None:
        mx, my, mz = FRAME.to_machine_mm((x, y, z))
        self.line(f"$J=G90G53G21X{mx:.4f}Y{my:.4f}Z{mz:.4f}F{feed:g}")

    def go(self, x: float, y: float, z: float, feed: float = 1200.0) -> None:
        """Jog and let it arrive."""
        self.jog(x, y, z, feed)
        while self.controller.state != "Idle":
            self.clock.sleep_s(0.5)


def last(
    contact: GelContact, state: State, tip: tuple[float, float, float], step_mm: float
) -> State:
    """The state at the end of the solver's own path."""
    return list(follow_path(contact, state, tip, step_mm))[-1]


def test_scene_ends_on_the_solved_path() -> None:
    bench = Bench()
    bench.go(0.0, 0.0, 1.0)
    bench.go(0.0, 0.0, -0.8, 60.0)
    state = last(bench.contact, bench.contact.rest(), (0.0, 0.0, 0.8), 0.1)
    assert bench.force_n() == pytest.approx(state.force_n, rel=1e-5, abs=1e-6)
    assert bench.force_n()[2] < 0


def test_no_solve_for_what_nobody_saw() -> None:
    bench = Bench()
    bench.go(0.0, 0.0, 1.0)
    bench.go(0.0, 0.0, -0.8, 60.0)
    bench.go(0.0, 0.0, 1.0, 60.0)  # out of contact again, unobserved
    assert bench.scene.observe().displacement_mm() is None
    assert bench.solves == 0


def test_only_nearby_knots_are_solved() -> None:
    bench = Bench()
    bench.go(0.0, 0.0, 0.0)
    bench.jog(0.0, 0.0, -1.0, 60.0)  # 1 s, ten knots
    bench.clock.sleep_s(0.25)
    bench.scene.observe()
    assert bench.solves in (2, 3)
    at_quarter = bench.solves
    bench.scene.observe()
    assert bench.solves == at_quarter


@pytest.mark.slow
def test_cancelled_jog_keeps_the_true_path() -> None:
    """Stopped between two knots, the gel is where the tip is, not where the plan led."""
    bench = Bench()
    bench.go(0.0, 0.0, 0.0)
    bench.go(0.0, 0.0, -0.8, 60.0)
    bench.jog(2.0, 0.0, -0.8, 60.0)
    bench.clock.sleep_s(0.9)
    bench.scene.observe()  # looks ahead one knot
    bench.controller.write(b"\x85")
    bench.clock.sleep_s(1.0)
    stopped = FRAME.to_sensor_mm(bench.controller.position_mm())
    assert 0.7 < stopped[0] < 1.1
    seen = bench.scene.observe()
    state = last(bench.contact, bench.contact.rest(), (0.0, 0.0, 0.8), 0.1)
    state = last(bench.contact, state, (stopped[0], 0.0, 0.8), 0.25)
    assert bench.force_n() == pytest.approx(state.force_n, rel=0.01, abs=5e-3)
    ahead = seen.displacement_mm()
    assert ahead is not None
    peak = float(np.abs(ahead[..., 0]).max())
    assert peak == pytest.approx(float(np.abs(state.displacement_mm[..., 0]).max()), rel=0.01)


@pytest.mark.slow
def test_batched_wrenches_equal_single_ones() -> None:
    many, single = Bench(drawn=False), Bench(drawn=False)
    for bench in (many, single):
        bench.go(0.0, 0.0, 0.5)

    def drive(bench: Bench, look: Callable[[], None]) -> None:
        """Down through first touch, a rest, a shear that is cut short, a rest, out of the gel."""
        for line, waits in (
            ((0.0, 0.0, -0.8, 60.0), [0.3] * 7),
            ((1.5, 0.0, -0.8, 60.0), [0.3] * 3),
        ):
            bench.jog(*line)
            for wait_s in waits:
                bench.clock.sleep_s(wait_s)
                look()
        bench.controller.write(b"\x85")
        bench.clock.sleep_s(0.4)
        look()
        bench.jog(1.5, 0.0, 0.5, 60.0)
        bench.clock.sleep_s(2.5)
        look()

    found: list[np.ndarray] = []
    last_ns = [many.clock.now_ns()]

    def look_back() -> None:
        times = np.arange(last_ns[0] + 10**8, many.clock.now_ns() + 1, 10**8)
        found.append(many.scene.wrenches(times))
        last_ns[0] = int(times[-1])

    looks: list[float] = []
    ticks = single.clock.schedule(
        10.0, lambda t: looks.extend(single.scene.wrenches(t[i : i + 1])[0] for i in range(len(t)))
    )
    drive(many, look_back)
    drive(single, lambda: None)
    ticks.cancel()
    assert np.concatenate(found) == pytest.approx(np.array(looks), abs=1e-9)
    assert np.concatenate(found)[:, 2].min() < -0.5
    assert np.concatenate(found)[:, 0].max() > 0.1
    assert not found[-1][-1].any()


def test_history_ends_when_tip_leaves() -> None:
    bench = Bench()
    bench.go(0.0, 0.0, 0.0)
    bench.go(0.0, 0.0, -0.5, 60.0)
    bench.go(1.0, 0.0, -0.5, 60.0)
    assert bench.force_n()[0] > 0.1
    bench.go(1.0, 0.0, 1.0)
    bench.go(0.0, 0.0, 1.0)
    bench.go(0.0, 0.0, -0.5, 60.0)
    force = bench.force_n()
    assert abs(force[0]) < 1e-3 * abs(force[2])


def test_face_below_floor_is_clamped_flagged() -> None:
    free, held = (PathSolver(lambda: UNIT, observed=ALL, floor_mm=mm) for mm in (12.0, 0.7))
    above, below = (p.next(0, (0.0, 0.0, -1.0), 1.0) for p in (free, held))
    assert above.displacement_mm is not None
    assert below.displacement_mm is not None
    deep = above.displacement_mm[..., 2] < -0.7
    assert deep.sum() > 5
    assert np.all(below.displacement_mm[deep, 2] == np.float32(-0.7))
    assert np.array_equal(below.displacement_mm[~deep], above.displacement_mm[~deep])
    assert np.array_equal(below.displacement_mm[..., :2], above.displacement_mm[..., :2])
    assert "floor" not in [flag.id for flag in above.flags]
    (told,) = [flag.text for flag in below.flags if flag.id == "floor"]
    assert told.startswith(f"{deep.sum()} of {deep.size} points of the face lie below the ")
    assert below.force_n == above.force_n


@pytest.mark.slow
def test_rest_of_several_knots_is_followed() -> None:
    """Looked at one by one or all at once, the force goes through every knot of the rest."""
    gel = GelMaterial(1.0, prony=((1.0, 2.0),))
    down = (0.0, 0.0, -1.0)
    parts = (0.25, 0.25, 0.5, 1.0)
    planned = [KnotPose(down, 0.05, 1.0), *(KnotPose(down, s, 0.0) for s in parts)]
    scene, reach = (
        (SkinDimensions(), gel, parse_indenter("sphere:15")),
        Reach((0.0, 0.5), (0.0, 0.0), 1.0),
    )
    choice = select_level(*scene, reach, level="hyperelastic", spacing_mm=3.0)
    contact = open_contact(*scene, choice, lattice_mm=1.0)
    press = PlannedPress(PathSolver(lambda: contact, planned), "", ((0.0, 0.0, 0.0), down))
    bench = Bench(drawn=False)
    bench.scene = GelScene(
        bench.controller, bench.clock, FRAME, Increments(1.0, 0.5), lambda *asked: press, None
    )
    bench.go(0.0, 0.0, 0.0)
    bench.scene.begin("")
    bench.jog(0.0, 0.0, -1.0, 1200.0)
    bench.clock.sleep_s(0.1)
    start_ns = bench.clock.now_ns()
    bench.scene.observe()
    bench.clock.sleep_s(1.3)
    one = -bench.force_n()[2]  # from here, and not from the rest's beginning
    bench.clock.sleep_s(3.0)
    t_ns = start_ns + np.arange(int(1.35e9), int(4.2e9), 10_000_000)
    forces = -bench.scene.wrenches(t_ns)[:, 2]
    bench.go(0.5, 0.0, -1.0, 1200.0)
    bench.scene.observe()
    assert [k.key for k in bench.scene.knots[:6]] == [0, 1, 2, 3, 4, 5]
    knots = [-k.force_n[2] for k in bench.scene.knots[1:6]]
    assert (np.diff(knots) < 0).all()
    assert knots[0] > one > forces[0] >= forces[-1] == knots[-1]
    assert (np.diff(forces) <= 0).all()


def test_oblong_lattice_maps_to_square() -> None:
    x, y = np.linspace(-18.3, 18.3, 75), np.linspace(-17.0, 17.0, 69)

    def field(xs: np.ndarray, ys: np.ndarray) -> np.ndarray:
        yy, xx = np.meshgrid(ys, xs, indexing="ij")
        return np.stack([np.sin(xx / 4), np.cos(yy / 5), xx * yy / 100], axis=-1)

    crop = LatticeCrop(x, y, (10.0, 8.0))
    lattice = crop.lattice
    xs = lattice.x0_mm + lattice.spacing_mm * np.arange(lattice.nx)
    ys = lattice.y0_mm + lattice.spacing_mm * np.arange(lattice.ny)
    assert xs[0] < -10 < 10 < xs[-1]
    assert ys[0] < -8 < 8 < ys[-1]
    assert np.abs(crop(field(x, y)) - field(xs, ys)).max() < 1e-5
