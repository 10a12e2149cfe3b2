"""pyvale and al-dic asked for a flow; "not run" where `.venv-peers` is absent."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import flow_peers, peer
from deltact_fab.errors import RunFailed
from deltact_fab.numerics.engines.flow_frames import FlowSequence

SHIFT_PX = np.array([3.25, -1.5])


def shifted() -> FlowSequence:
    rest = np.random.default_rng(4).normal(128, 300, (256, 320))
    rest = 128 + cv2.GaussianBlur(rest - 128, (0, 0), 1.8)
    y, x = np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(320), indexing="ij")
    turn = np.exp(-2j * np.pi * (x * SHIFT_PX[0] + y * SHIFT_PX[1]))
    moved = np.fft.ifft2(np.fft.fft2(rest) * turn).real
    truth = np.broadcast_to(SHIFT_PX, (256, 320, 2)).astype(np.float32)
    images = np.stack([rest, moved]).clip(0, 255).astype(np.uint8)
    return FlowSequence(images, truth)


@pytest.mark.parametrize("method", flow_peers.PEERS)
def test_without_the_environment_it_is_not_run(
    method: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(peer.VARIABLE, raising=False)
    monkeypatch.setattr(peer, "PYTHON", tmp_path / "python")
    with pytest.raises(RunFailed, match="not run: no"):
        flow_peers.answer(method, flow_peers.Question(shifted, 16), shifted())


@pytest.mark.slow
@pytest.mark.skipif(peer.python() is None, reason="not run: `make peers` brings pyvale and al-dic")
@pytest.mark.parametrize("method", flow_peers.PEERS)
def test_a_shift_comes_back_from_a_peer(method: str) -> None:
    scene = shifted()
    flow, cpu_s, version = flow_peers.answer(method, flow_peers.Question(shifted, 16), scene)
    assert version.startswith(method)
    assert cpu_s > 0
    given = np.isfinite(flow[..., 0])
    assert given.sum() > 500  # of 32 x 40 nodes less the border
    assert np.median(flow[given], axis=0) == pytest.approx(SHIFT_PX, abs=0.03)


def test_a_method_of_ours_answers_everywhere() -> None:
    scene = shifted()
    flow, _, _ = flow_peers.answer("fused", flow_peers.Question(shifted, 16), scene)
    assert np.isfinite(flow).all()
    assert np.median(flow[40:-40, 40:-40], axis=(0, 1)) == pytest.approx(SHIFT_PX, abs=0.03)
