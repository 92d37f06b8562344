"""`eimi segment` follows the beam through recorded frames, and stores its motion: a free vibration or creep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse, to_toml
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.steps import RingDownStep, SetPoint
from eimi_lab.dataset.writing import DatasetWriter
from tests.shared.filmed_beam import LEVEL, STRIP, Flick

Run = Callable[..., tuple[int, str]]

PROTOCOL = """
name = "short"
material = "silicone"
frames_per_state = 1
creep = true
ring_down = { seconds = 0.4 }
current = { values_A = [0.0, 0.3] }
ramp = { rate_A_per_s = 10.0, step_A = 0.3, tolerance_A = 0.02 }
limits = { current_A = 1.0, voltage_V = 10.0 }
settle = { noise_ratio = 1.5, pairs = 2, drift_window_s = 0.5, timeout_s = 5.0 }
"""


@pytest.fixture
def recorded(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    # A dataset with one ring-down (free vibration) and two states with creep; in colour for the parameter "colour".
    film = Flick(seconds=0.4)
    images = list(film.frames())
    still = next(iter(Flick(seconds=1 / 120, amplitude_mm=0.0).frames()))
    if getattr(request, "param", "grey") == "colour":
        *images, still = (np.stack([grey // 3 + 100, grey // 2 + 90, grey], axis=-1) for grey in (*images, still))
    protocol = parse(Protocol, PROTOCOL, "protocol")
    specimen, calibration = (parse(type(of), to_toml(of), "file") for of in (STRIP, LEVEL))
    with DatasetWriter(tmp_path / "run.h5", Header(specimen, calibration, protocol), Frame(still, 0, 0.0)) as writer:
        for state, current_A in enumerate((0.0, 0.3)):
            begun_s = 10.0 * state
            transient = [
                Moment(Frame(still, k, 0.0), begun_s + at_s, at_s, current_A) for k, at_s in enumerate((0.5, 1.0, 2.0))
            ]
            points = [SetPoint(begun_s - 0.1, 0.15, 0.01), SetPoint(begun_s, 0.3, 0.01)] if state else []
            writer.append_state(
                [Frame(still, 0, 0.0)],
                current_A=current_A,
                field_mT=0.0,
                time_s=[begun_s + 3.0],
                transient=transient,
                set_points=points,
            )
        with writer.ring_down() as stream:
            for image in images:
                stream.put(image)
        step_s = 20.0 - 1e-3
        writer.end_ring_down(
            RingDownStep(0, 0.3, 0.0, step_s, 2e-3, len(images), 1, film.rate_Hz),
            [
                Moment(Frame(image[:0], k, 0.0), 20.0 + at_s, 20.0 + at_s - step_s, 0.0)
                for k, (image, at_s) in enumerate(zip(images, film.times_s, strict=True))
            ],
            [SetPoint(step_s, 0.0, 2e-3)],
        )
    return tmp_path / "run.h5"


@pytest.mark.parametrize("recorded", ["grey", "colour"], indirect=True)
def test_segment_computes_motions_from_the_recorded_frames(recorded: Path, run: Run) -> None:
    code, message = run("segment", recorded)
    assert code == 0, message
    film = Flick(seconds=0.4)
    with open_dataset(recorded) as dataset:
        (ring_down,), (creep,) = dataset.ring_downs(), dataset.creeps()
        assert dataset.edges() is not None
    assert (ring_down.from_A, ring_down.to_A, ring_down.lost_frames) == (0.3, 0.0, 1)
    assert ring_down.step_uncertainty_s == 2e-3
    assert [current for _, current in ring_down.history] == [0.15, 0.3]
    assert ring_down.history[-1][0] == pytest.approx(10.0 - 20.0 + 1e-3)
    np.testing.assert_allclose(ring_down.time_s[:, 0], film.times_s + 1e-3, atol=1e-9)
    truth = np.stack([film.centre_mm(ring_down.rest_mm[:, 0], at_s) for at_s in film.times_s])
    assert np.abs(ring_down.points_mm - truth).max() < 0.05
    # The first state begins without a step of the current, and has no creep.
    assert (creep.from_A, creep.to_A) == (0.0, 0.3)
    np.testing.assert_allclose(creep.time_s[:, 0], [0.5, 1.0, 2.0])
    assert np.ptp(creep.points_mm[:, -1, 1]) < 0.02


def test_a_second_segmentation_replaces_the_motions_and_keeps_the_frames(recorded: Path, run: Run) -> None:
    assert run("segment", recorded)[0] == 0
    assert run("segment", recorded)[0] == 0
    with open_dataset(recorded) as dataset:
        assert len(dataset.ring_downs()) == len(dataset.creeps()) == 1
        assert len(dataset.recorded_ring_downs()[0][1]) == 48


def test_recovery_keeps_ring_downs_and_leaves_out_damaged_frames(recorded: Path, run: Run) -> None:
    with h5py.File(recorded) as file:
        chunk = file["entry/ring_down/frames"].id.get_chunk_info(7)
    raw = bytearray(recorded.read_bytes())
    raw[chunk.byte_offset + 100 : chunk.byte_offset + 140] = bytes(40)
    recorded.write_bytes(raw)
    code, message = run("recover", recorded, "-o", recorded.with_name("whole.h5"))
    assert code == 0, message
    assert "damaged frames left out of ring_down: 1" in message
    with open_dataset(recorded.with_name("whole.h5")) as dataset:
        ((step, frames),) = dataset.recorded_ring_downs()
        assert (step.frames, len(list(frames.images()))) == (48, 47)
        assert 7 not in frames.numbers


def test_the_virtual_beam_swings_after_the_coil_is_switched_off(tmp_path: Path) -> None:
    shipped, specimen = load_rig("virtual"), load_specimen("type1")
    assert shipped.virtual is not None
    small = {"mesh": (8, 1, 1), "frame_size_px": (160, 128)}
    place = {"pixels_per_mm": 3.0, "clamp_midpoint_px": (80.0, 16.0)}
    rig = shipped.model_copy(
        update={
            "virtual": shipped.virtual.model_copy(update=small),
            "calibration": shipped.calibration.model_copy(update=place),
        }
    )
    text = PROTOCOL.replace("silicone", specimen.specimen.material).replace("0.4 }", "1.0, rate_Hz = 60.0 }")
    protocol = parse(Protocol, text, "protocol")
    paths = [tmp_path / "one.h5", tmp_path / "two.h5"]
    for path in paths:
        with open_bench(rig, specimen, protocol.limits, rate_Hz=protocol.rate_Hz) as bench:
            assert bench.camera.settings.frame_rate_Hz == 60.0
            acquire(protocol, specimen, rig, bench, path)
    middles = []
    for path in paths:
        with open_dataset(path) as dataset:
            ((step, frames),) = dataset.recorded_ring_downs()
            images = np.stack(list(frames.images()))
        np.testing.assert_allclose(np.diff(frames.time_s), 1 / 60, rtol=1e-6)
        assert step.lost == 0
        dark = images[:, 88:98] < 0.3 * np.percentile(images, 90)
        middles.append((dark * np.arange(160)).sum(axis=(1, 2)) / dark.sum(axis=(1, 2)))
    np.testing.assert_array_equal(*middles)  # the same seed gives the same ring-down
    after = middles[0][frames.elapsed_s > 0.05]
    crossings = int((np.diff(np.sign(after - np.median(after[-20:]))) != 0).sum())
    assert 6 <= crossings <= 20  # the frequency is between 3 and 10 Hz
    assert np.ptp(after[:20]) > 1.5 * np.ptp(after[-20:])
