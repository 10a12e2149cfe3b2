"""A run through a lens: raw frames in the record, rectified by what was calibrated; the true lens
draws, is known to the truth, and to nothing else."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rig_text import VIRTUAL_STAGE

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.bench.rig import config
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.estimate.measure.flow.renewed import FlowMethod
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.flat import FlatField, camera_toml
from deltact_fab.sensor.optics.lattice import PointSampler
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.experiment.request import RunRequest, rig_kind
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.lens import true_lens

PROTOCOL = """
name = "through-a-lens"
indenters = ["sphere:6"]
positions_mm = [[0.0, 0.0], [0.8, 0.5]]
depths_mm = [0.6]
channels = {channels}
[shear]
amplitude_mm = 0.5
axes = ["x"]
[capture]
rate_hz = 0.5
[specimen]
design = "{design}"
"""
DESIGN = """
[optics]
image_width_px = 200
image_height_px = 160
"""
RIG = f"""{VIRTUAL_STAGE}[camera]
model = "{{model}}"
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.3
shear_increment_mm = 0.5
[virtual.lens]
f_px = {{f_px}}
cx_px = 212.5
cy_px = 168.25
tilt_x_deg = 1.5
pupil_shift_mm = 0.2
width_px = 420
height_px = 340
"""
TRUE_F_PX = 391.25
TRUE = Fisheye(
    f_px=TRUE_F_PX, cx_px=212.5, cy_px=168.25, tilt_x_deg=1.5, pupil_shift_mm=0.2,
    width_px=420, height_px=340,
)  # fmt: skip
# Off by up to 8 px in the view: what is wrong in truth or rectification shows.
CALIBRATED = Fisheye(
    f_px=396.0, cx_px=207.0, cy_px=170.0, tilt_x_deg=0.5, width_px=420, height_px=340
)


def written(folder: Path, channels: str = '["image", "dots", "shear"]') -> tuple[str, str]:
    """Paths of protocol and rig file, with their design and camera beside them."""
    folder.mkdir(exist_ok=True)
    (folder / "design.toml").write_text(DESIGN)
    (folder / "camera.toml").write_text(camera_toml(CALIBRATED))
    protocol, rig = folder / "short.toml", folder / "bench.toml"
    protocol.write_text(PROTOCOL.format(channels=channels, design=folder / "design.toml"))
    rig.write_text(RIG.format(model="camera.toml", f_px=TRUE_F_PX))
    return str(protocol), str(rig)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lens")
    run_experiment(RunRequest(*written(folder), folder / "run", seed=3))
    return folder / "run"


def deepest(run: Run) -> str:
    frames = run.frames("sphere-6/p2")
    return str(frames["frame_id"].iloc[int(frames["x_mm"].argmax())])


@pytest.mark.slow
def test_raw_frames_are_rectified_on_reading(run: Path) -> None:
    opened = open_run(run)
    row = opened.frames().iloc[3]
    data = (run / row.file).read_bytes()
    assert hashlib.sha256(data).hexdigest() == row.sha256
    raw, image = opened.raw(row.file), opened.image(row.file)
    assert (raw.shape, image.shape) == ((340, 420, 3), (160, 200, 3))
    view = opened.camera
    assert view == Rectified(CALIBRATED, 0.0378, 200, 160)
    assert np.array_equal(image, view.rectify(raw))


def test_flat_field_is_stored_and_applied(tmp_path: Path) -> None:
    protocol, rig = written(tmp_path, '["image"]')
    before, _, after = Path(protocol).read_text().partition("[shear]")
    press = before.replace(", [0.8, 0.5]", "") + after[after.index("[capture]") :]
    Path(protocol).write_text(press.replace("rate_hz = 0.5", "settle_s = 1.0"))
    share = np.full((340, 420, 3), 0.5, np.float32)
    (tmp_path / "light.png").write_bytes(FlatField(share).to_png())
    (tmp_path / "camera.toml").write_text(camera_toml(CALIBRATED, {"flat": {"file": "light.png"}}))
    run_experiment(RunRequest(protocol, rig, tmp_path / "run"))
    (tmp_path / "light.png").unlink()
    opened = open_run(tmp_path / "run")
    file = opened.frames().iloc[0].file
    assert isinstance(opened.camera, Rectified)
    dim = opened.camera.rectify(opened.raw(file)).astype(int)
    assert np.abs(opened.image(file) - np.minimum(2 * dim, 255)).max() <= 1


def test_run_file_has_lens_digest_only(run: Path) -> None:
    meta = (run / "run.json").read_text()
    assert str(TRUE_F_PX) not in meta
    assert list(json.loads(meta)["rig"]["virtual"]["lens"]) == ["sha256"]
    truth = open_run(run).truth()
    assert truth is not None
    assert truth.lens == TRUE


def test_true_flow_uses_the_true_lens(run: Path) -> None:
    opened = open_run(run)
    truth, view = opened.truth(), opened.camera
    assert truth is not None
    frame_id = deepest(opened)
    px = np.random.default_rng(0).integers((0, 0), (200, 160), (300, 2))
    at_mm = TRUE.rest_mm(CALIBRATED.rest_px(view.rest_mm(px)))
    assert np.hypot(*(at_mm - view.rest_mm(px)).T).max() > 0.2  # the calibration is that far off
    u_mm = PointSampler(truth.lattice, at_mm)(truth.displacement_mm(frame_id))
    moved_mm = np.column_stack((at_mm, np.zeros(300))) + u_mm
    lands_px = view.rest_px(CALIBRATED.rest_mm(TRUE.project_px(moved_mm)))
    flow = truth.flow_px(frame_id)
    assert flow.shape == (160, 200, 2)
    assert np.abs(lands_px - px).max() > 10
    np.testing.assert_allclose(flow[px[:, 1], px[:, 0]], lands_px - px, atol=1e-3)
    np.testing.assert_allclose(truth.points_px(frame_id, at_mm), lands_px - px, atol=1e-9)
    in_plane = truth.flow_and_in_plane(frame_id)[1]
    np.testing.assert_allclose(in_plane[px[:, 1], px[:, 0]], u_mm[:, :2], atol=1e-12)


def test_rectified_flow_matches_the_truth(run: Path) -> None:
    """Drawing, rectification and truth agree: any of them alone moved would show."""
    opened = open_run(run)
    frames = opened.frames("sphere-6/p2").set_index("frame_id")
    truth, frame_id = opened.truth(), deepest(opened)
    assert truth is not None
    images = (opened.image(frames.loc[i, "file"])[..., 1] for i in (frames.index[0], frame_id))
    found, true = FlowMethod("dis-medium").between(*images), truth.flow_px(frame_id)
    inner = (slice(20, -20), slice(20, -20))
    error_px = np.hypot(*np.moveaxis((found - true)[inner], -1, 0))
    assert np.hypot(*np.moveaxis(true[inner], -1, 0)).max() > 10
    assert error_px.mean() < 0.15
    # The truth of the calibrated lens, taken for the true one, is another by more than that.
    (run / "truth" / "lens.json").rename(run / "kept.json")
    (run / "truth" / "lens.json").write_text(json.dumps(CALIBRATED.as_dict()))
    try:
        other = open_run(run).truth()
        assert other is not None
        off_px = np.hypot(*np.moveaxis((found - other.flow_px(frame_id))[inner], -1, 0))
        assert off_px.mean() > 2 * error_px.mean()
    finally:
        (run / "kept.json").replace(run / "truth" / "lens.json")


class Stop(Exception):
    pass


@pytest.mark.slow
def test_resumed_run_equals_undisturbed_run(run: Path, tmp_path: Path) -> None:
    words = written(tmp_path / "given")
    out = tmp_path / "out"

    def stop(done: int, total: int, what: str) -> None:
        if "p2" in what and done > 0.7 * total:
            raise Stop

    with pytest.raises(Stop):
        run_experiment(RunRequest(*words, out, seed=3, progress=stop))
    # A file of another name with the same lens is the same lens.
    rig = Path(words[1])
    shutil.move(tmp_path / "given" / "camera.toml", tmp_path / "given" / "again.toml")
    rig.write_text(RIG.format(model="again.toml", f_px=TRUE_F_PX))
    summary = run_experiment(RunRequest(*words, out, seed=3), resume=True)
    assert summary["kept_frames"] > 0
    for part in ("images", "truth"):
        names = {p.name for p in (run / part).iterdir()}
        assert {p.name for p in (out / part).iterdir()} == names
        for name in names:
            assert (out / part / name).read_bytes() == (run / part / name).read_bytes(), name


@pytest.mark.parametrize(
    ("true_f_px", "calibrated_f_px", "says"),
    [
        (TRUE_F_PX + 1, 396.0, r"rig\.virtual\.lens\.sha256: .* in the folder"),
        (TRUE_F_PX, 396.5, r"camera\.lens\.f_px: 396\.0 in the folder, 396\.5 now"),
    ],
)
def test_resume_with_another_lens_is_refused(
    run: Path, tmp_path: Path, true_f_px: float, calibrated_f_px: float, says: str
) -> None:
    protocol, rig = written(tmp_path)
    shutil.copytree(run, tmp_path / "out")
    (tmp_path / "out" / "summary.json").unlink()
    shutil.copy(run / "protocol.toml", protocol)
    Path(rig).write_text(RIG.format(model="camera.toml", f_px=true_f_px))
    text = camera_toml(CALIBRATED).replace("f_px = 396.0", f"f_px = {calibrated_f_px}")
    (tmp_path / "camera.toml").write_text(text)
    with pytest.raises(InputError, match=f"cannot be resumed: {says}"):
        run_experiment(RunRequest(protocol, rig, tmp_path / "out", seed=3), resume=True)


def test_truth_without_lens_is_damaged(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "out")
    (tmp_path / "out" / "truth" / "lens.json").unlink()
    with pytest.raises(RunFailed, match=r"lens\.json: cannot be read"):
        open_run(tmp_path / "out").truth()


@pytest.mark.slow
def test_uncalibrated_lens_warns_and_uses_design(tmp_path: Path) -> None:
    protocol, rig = written(tmp_path, '["image"]')
    text = Path(protocol).read_text()
    Path(protocol).write_text(text.replace('[shear]\namplitude_mm = 0.5\naxes = ["x"]\n', ""))
    text = Path(rig).read_text().replace('[camera]\nmodel = "camera.toml"\n', "")
    Path(rig).write_text(text.split("[virtual.lens]")[0] + "[virtual.lens]\nf_px = 390.0\n")
    summary = run_experiment(RunRequest(protocol, rig, tmp_path / "out", seed=3))
    (line,) = [note for note in summary["notes"] if "not calibrated" in note]
    assert line.startswith("WARNING: lens not calibrated, the design's lens is used: ")
    assert open_run(tmp_path / "out").camera.lens == Fisheye()


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        (None, r"bench\.toml: camera\.model: .*camera\.toml: no such file; `deltact-fab cal"),
        ('[camera]\nmodel = "pinhole"\nmm_per_px = 0.04\nwidth_px = 9\nheight_px = 9\n'
         "eye_distance_mm = 12.0\n", r"camera\.model: 'pinhole'; a virtual rig needs a 'fisheye'"),
        ('[camera]\nmodel = "fisheye"\nfpx = 3.0\n', r"camera\.toml: camera: fpx: unknown key"),
        ('[camera]\nmodel = "fisheye"\n', r"camera\.toml: an image of 1280 x 720 px, and"),
        (camera_toml(Fisheye(f_px=200.0, cx_px=209.5, cy_px=169.5, width_px=420, height_px=340)),
         r"camera\.toml: the view's border is up to \d\.\d mm off that of the true camera"),
    ],
)  # fmt: skip
def test_unusable_camera_file_leaves_no_folder(
    camera: str | None, says: str, tmp_path: Path
) -> None:
    words = written(tmp_path)
    (tmp_path / "camera.toml").unlink()
    if camera is not None:
        (tmp_path / "camera.toml").write_text(camera)
    with pytest.raises(InputError, match=says) as why:
        run_experiment(RunRequest(*words, tmp_path / "out"))
    assert "\n" not in str(why.value)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match=says):  # `protocol check` says so too
        RunRequest(*words).checks()


def test_shipped_fisheye_is_tracked_when_calibrated() -> None:
    rig, source = config.load_rig("fisheye")
    assert rig.kind == "virtual"
    true = true_lens(rig, SensorDimensions())
    view = rig_kind(rig, source).camera(plan.load_protocol("smoke")[0], SensorDimensions())
    assert isinstance(view, Rectified)
    assert view.lens != true
    x, y = np.meshgrid(np.arange(0, view.width_px, 17.0), np.arange(0, view.height_px, 17.0))
    face = view.rest_mm(np.stack((x, y), -1))
    for z_mm, most_px in ((0.0, 0.1), (-3.0, 0.5), (-6.0, 1.0)):
        points = np.dstack((face, np.full(x.shape, z_mm)))
        off_px = np.hypot(
            *np.moveaxis(true.project_px(points) - view.lens.project_px(points), -1, 0)
        )
        assert 0 < np.percentile(off_px, 95) < most_px
