"""A run stores frames of the moving beam between its states, as the protocol requests."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, InstrumentDisconnected
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.transients import Transient
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recordings import Recording
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.segmentation import segment


def add_to_protocol(setup: Any, lines: str) -> None:
    setup.protocol = parse(Protocol, f"{lines}\n{setup.protocol.text}", "p")


def transients(path: Path) -> list[Recording | None]:
    with open_dataset(path) as dataset:
        return [dataset.transient(state.index) for state in dataset.states]


def middle(image: np.ndarray) -> float:
    dark = np.flatnonzero(image.mean(axis=0) < 115)
    return float(dark[0] + dark[-1]) / 2


def test_frames_are_stored_while_the_beam_settles(setup: Any) -> None:
    add_to_protocol(setup, "transients = { frames_per_state = 6 }")
    setup.run()
    kept = transients(setup.path)
    assert all(one is not None and 1 <= len(one.images) <= 6 for one in kept)
    last = kept[3]
    assert last is not None
    assert set(last.belongs_to.tolist()) == {3}
    assert set(last.set_A.tolist()) == {0.3}
    ratios = last.elapsed_s[1:] / last.elapsed_s[:-1]
    assert ratios.min() > 1.2  # logarithmically spaced, whatever the rate of the camera
    np.testing.assert_allclose(np.diff(last.time_s), np.diff(last.elapsed_s))
    swings = [abs(middle(image) - 67.0) for image in last.images]
    assert max(swings) > 1.0  # these frames show the motion that the frames of the state no longer show
    assert swings[-1] < 0.6
    with open_dataset(setup.path) as dataset:
        assert middle(dataset.images(3)[-1]) == pytest.approx(67.0, abs=0.5)
    with h5py.File(setup.path) as file:
        of_states = file["entry/data/time"][()]
        assert last.time_s[-1] <= of_states[-2] < of_states[-1]


class Moved:
    # A replacement for a coil whose current was changed at 50 s on the clock of the run.

    changed_s, asked_A = 50.0, 0.3


def seen(budget: int, lasts_s: float, times_s: list[float]) -> list[tuple[float, float, float]]:
    kept = Transient(budget, lasts_s, Moved())  # type: ignore[arg-type]
    for at_s in times_s:
        kept.see(Frame(np.zeros((2, 2), np.uint8), 1, 0.0), at_s)
    return [(moment.time_s, moment.elapsed_s, moment.set_A) for moment in kept.moments]


def test_frames_of_a_fast_camera_are_equally_spaced_in_the_logarithm_of_time() -> None:
    kept = seen(5, 99.99, [50.01 + 0.001 * number for number in range(20_001)])
    elapsed_s = [moment[1] for moment in kept]
    # Five equal intervals from 0.01 s to 0.01 + 99.99 s; each begins with a frame.
    np.testing.assert_allclose(elapsed_s, np.geomspace(0.01, 100.0, 6)[:5], rtol=0.03)
    assert all(time_s - 50.0 == pytest.approx(after_s) for time_s, after_s, _ in kept)
    assert {set_A for *_, set_A in kept} == {0.3}


def test_a_slow_camera_still_gives_all_frames_of_the_budget() -> None:
    assert [moment[1] for moment in seen(5, 4.0, [51.0, 52.0, 53.0, 54.0, 55.0, 56.0])] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert seen(0, 4.0, [51.0, 52.0]) == []


def test_a_frame_at_the_time_of_the_set_point_counts_as_1_ms_later() -> None:
    assert [moment[1] for moment in seen(2, 1.0, [50.0, 50.0005, 52.0])] == [0.001, 2.0]


def test_no_frames_of_the_moving_beam_are_stored_if_the_protocol_says_so(setup: Any) -> None:
    add_to_protocol(setup, "transients = { frames_per_state = 0 }")
    setup.run()
    assert transients(setup.path) == [None] * 4
    with h5py.File(setup.path) as file:
        assert "transients" not in file["entry"]


def test_of_a_beam_that_never_comes_to_rest_at_most_the_given_number_of_frames_is_stored(setup: Any) -> None:
    setup.camera.sway_px = 0.5
    setup.run()
    kept = transients(setup.path)[2]
    assert kept is not None
    assert len(kept.images) == 12
    assert kept.elapsed_s[-1] == pytest.approx(5.0, rel=0.35)  # spread over the whole waiting time


def test_a_crash_loses_no_transient_of_a_state_that_was_acknowledged(setup: Any) -> None:
    copies: list[Path] = []

    def crash(number: int) -> None:
        if setup.coil.state.set_current_A == 0.3:
            copies.append(setup.path.with_name("crashed.h5"))
            shutil.copyfile(setup.path, copies[0])
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = crash
    with pytest.raises(InstrumentDisconnected):
        setup.run()
    whole = setup.path.with_name("whole.h5")
    assert recover(copies[0], whole) == 3
    for crashed, recovered in zip(transients(copies[0]), transients(whole), strict=True):
        assert crashed is not None
        assert recovered is not None
        np.testing.assert_array_equal(crashed.images, recovered.images)
        np.testing.assert_array_equal(crashed.elapsed_s, recovered.elapsed_s)
    setup.camera.event = lambda number: None
    setup.run(resume=True)
    kept = transients(setup.path)
    assert [one.belongs_to[0] for one in kept if one is not None] == [0, 1, 2, 3]


def test_recovery_leaves_out_only_the_damaged_frames_of_the_transients(setup: Any) -> None:
    setup.run()
    before = transients(setup.path)
    assert before[1] is not None
    with h5py.File(setup.path) as file:
        chunk = file["entry/transients/frames"].id.get_chunk_info(len(before[0].images) + 2)  # type: ignore[union-attr]
    raw = bytearray(setup.path.read_bytes())
    raw[chunk.byte_offset + 100 : chunk.byte_offset + 140] = bytes(40)
    setup.path.write_bytes(raw)
    messages: list[str] = []
    whole = setup.path.with_name("whole.h5")
    assert recover(setup.path, whole, say=messages.append) == 4
    assert messages == [f"{setup.path}: damaged frames left out of transients: 1"]
    after = transients(whole)
    assert after[1] is not None
    assert len(after[1].images) == len(before[1].images) - 1
    assert [one.flags for one in _states(whole)] == [()] * 4


def test_segmentation_does_not_change_the_frames_of_the_moving_beam(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 0.2 }")
    setup.run()
    before = transients(setup.path)
    segment(setup.path, lambda words: None)
    for one, other in zip(before, transients(setup.path), strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.images, other.images)
    with open_dataset(setup.path) as dataset:
        assert len(dataset.recorded_ring_downs()) == 1


def test_a_dry_run_prints_the_number_of_transient_frames_and_counts_the_ring_down(setup: Any) -> None:
    messages: list[str] = []
    add_to_protocol(setup, "ring_down = { seconds = 100 }\ntransients = { frames_per_state = 7 }")
    dry_run(setup.protocol, setup.specimen, setup.rig, messages.append)
    assert "transients: at most 7 frames of each state while the beam settles" in messages
    assert "ring-down: from 0.3 A to zero in one step, recorded for 100 s" in messages
    assert int(messages[-1].split()[1]) > 100


def _states(path: Path) -> Any:
    with open_dataset(path) as dataset:
        return dataset.states
