"""A run records ring-downs (free vibrations) after its states: the current steps to zero, and all frames are stored."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from pydantic import ValidationError

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import Frame, InstrumentError
from eimi_lab.acquisition import ring_downs as ring_downs_module
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.events import Event, RingDownStored
from eimi_lab.acquisition.run import check_request
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset.frame_stream import FrameStream
from eimi_lab.dataset.layout import frame_stack
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped


def add_to_protocol(setup: Any, lines: str) -> None:
    setup.protocol = parse(Protocol, f"{lines}\n{setup.protocol.text}", "p")


def middle(image: np.ndarray) -> float:
    dark = np.flatnonzero(image.mean(axis=0) < 115)
    return float(dark[0] + dark[-1]) / 2


def ring_downs(path: Path) -> list[tuple[Any, list[np.ndarray], Any]]:
    # Return the current step, images and frame data of each ring-down (free vibration) in a dataset.
    with open_dataset(path) as dataset:
        return [(step, list(frames.images()), frames) for step, frames in dataset.recorded_ring_downs()]


def test_every_frame_of_a_ring_down_is_stored_with_its_time(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 0.5 }")
    images: list[np.ndarray] = []
    grab = setup.camera.grab

    def remembered(timeout_s: float) -> Frame:
        frame = grab(timeout_s)
        if setup.coil.state.set_current_A == 0.0:
            images.append(frame.image)
        return frame

    setup.camera.grab = remembered
    events: list[Event] = []
    setup.run(on_event=events.append)
    assert setup.is_off()
    ((step, stored, frames),) = ring_downs(setup.path)
    # A frame takes 5 ms; a message to the supply advances the same simulated clock.
    assert 30 <= len(stored) == step.frames
    for earlier, later in zip(stored[-20:], images[-20:], strict=True):
        np.testing.assert_array_equal(earlier, later)
    assert 0.5 <= frames.elapsed_s[-1] < 1.5
    assert np.median(np.diff(frames.elapsed_s)) == pytest.approx(0.005)
    np.testing.assert_allclose(frames.time_s - frames.elapsed_s, step.time_s)
    assert (step.from_A, step.to_A, step.lost) == (0.3, 0.0, 0)
    assert 0 < step.uncertainty_s < 0.3
    assert step.rate_Hz == pytest.approx(200.0, rel=1e-3)
    assert middle(stored[-1]) == pytest.approx(64.0, abs=0.5)
    assert frames.set_A[0] in (0.0, 0.3)
    assert frames.set_A[-1] == 0.0
    (stored_event,) = [event for event in events if isinstance(event, RingDownStored)]
    assert (stored_event.frames, stored_event.lost, stored_event.flags) == (len(stored), 0, ())
    with open_dataset(setup.path) as dataset:
        points = dataset.set_points()
    assert [point.current_A for point in points] == [0.0, 0.1, 0.2, 0.3, 0.0][-len(points) :]
    assert points[-1].time_s == pytest.approx(step.time_s)


def test_ring_downs_are_repeated_from_the_current_in_the_protocol(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 0.5, from_A = 0.2, repeats = 3 }")
    setup.run()
    assert [step.from_A for step, _, _ in ring_downs(setup.path)] == [0.2] * 3
    assert [step.ring_down for step, _, _ in ring_downs(setup.path)] == [0, 1, 2]
    assert all(len(stored) == step.frames > 10 for step, stored, _ in ring_downs(setup.path))


def test_lost_frames_of_a_ring_down_are_counted_and_flagged(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 0.3, rate_Hz = 1000 }")
    grab = setup.camera.grab

    def losing(timeout_s: float) -> Frame:
        if setup.coil.state.set_current_A == 0.0 and setup.camera.number % 20 == 0:
            setup.camera.number += 2
        return grab(timeout_s)

    setup.camera.grab = losing
    events: list[Event] = []
    messages = setup.run(on_event=events.append)
    ((step, stored, _),) = ring_downs(setup.path)
    assert step.lost >= 2 * (len(stored) // 20)
    (event,) = [event for event in events if isinstance(event, RingDownStored)]
    assert event.lost == step.lost
    assert set(event.flags) == {"RING_DOWN_LOST", "RING_DOWN_SLOW"}
    assert f"{step.lost} frames lost, RING_DOWN_LOST, RING_DOWN_SLOW" in messages[-1]


def test_a_supply_that_cannot_be_set_to_zero_ends_the_ring_down_and_the_run(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 500 }")

    def deaf(data: bytes) -> bool:
        return data.startswith(b"ISET1:0.000") and setup.coil.state.set_current_A == 0.3

    setup.line.inject(Fault.SILENCE, deaf)
    with pytest.raises(InstrumentError):
        setup.run()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert not setup.coil.state.output
    ((step, stored, _),) = ring_downs(setup.path)
    # The step has no time of its own: it is stored as at the beginning of the recording.
    assert (step.uncertainty_s, step.rate_Hz, step.frames, step.lost) == (0.0, 0.0, len(stored), 0)


def test_after_ctrl_c_the_recorded_frames_of_the_ring_down_are_stored(setup: Any) -> None:
    add_to_protocol(setup, "ring_down = { seconds = 500 }")
    let_go: list[int] = []

    def ask(number: int) -> None:
        if setup.stored_all and setup.coil.state.set_current_A == 0.0:
            let_go.append(number)
            if len(let_go) == 20:
                signal.raise_signal(signal.SIGINT)

    setup.stored_all = False
    setup.camera.event = ask

    def watch(live: Any) -> None:
        setup.stored_all |= live.state == 3

    with pytest.raises(Stopped):
        setup.run(show=watch)
    assert setup.is_off()
    ((step, stored, _),) = ring_downs(setup.path)
    assert len(stored) == step.frames >= 20


def test_a_release_in_a_file_of_an_earlier_version_is_read_as_a_ring_down(setup: Any) -> None:
    add_to_protocol(setup, "release = { seconds = 0.2 }")
    assert setup.protocol.ring_down is not None
    assert setup.protocol.ring_down.seconds == 0.2
    setup.run()
    now = ring_downs(setup.path)
    with h5py.File(setup.path, "r+") as file:  # the format of an earlier version
        entry = file["entry"]
        entry.move("ring_down", "release")
        entry["release"].move("ring_down", "state")
        entry["release/state"][:] = 3
        del entry["ring_down_steps"], entry["set_points"]
    ((step, stored, frames),) = ring_downs(setup.path)
    assert step.from_A == 0.3
    assert step.frames == now[0][0].frames
    np.testing.assert_array_equal(stored[-1], now[0][1][-1])
    np.testing.assert_array_equal(frames.elapsed_s, now[0][2].elapsed_s)


@pytest.mark.parametrize(
    ("lines", "stored"),
    [
        ("ring_down = { seconds = 5.0, from_A = 0.0 }", "should not be zero, because the beam then does not move"),
        ("ring_down = { seconds = 5.0, from_A = 3.0 }", "ring_down.from_A goes to 3 A"),
        ("ring_down = { seconds = 0.0 }", "seconds"),
        (
            "creep = true\ntransients = { frames_per_state = 0 }",
            "transients.frames_per_state = 0 should be",
        ),
        ("release = { seconds = 1 }\nring_down = { seconds = 1 }", "release"),
    ],
)
def test_a_protocol_with_an_impossible_recording_is_refused(setup: Any, lines: str, stored: str) -> None:
    with pytest.raises((InputError, ValidationError), match=stored):
        add_to_protocol(setup, lines)


UP = "stop_A = 0.3\nstep_A = 0.1\n"


@pytest.mark.parametrize(
    ("currents", "rule", "words"),
    [
        ("up_and_down = true", "", r"ring_down: the last current of the run is 0 A.*; give ring_down\.from_A, the cur"),
        ("both_polarities = true", ", from_A = 0.3", r"ring_down\.from_A = 0\.3 .* leads .* swapped .*; use -0\.3, or"),
        ("", ", from_A = -0.3", r"ring_down\.from_A goes to -0\.3 A, but supply\.driver = 'korad' .* cannot reverse"),
    ],
)
def test_a_ring_down_that_is_impossible_after_the_states_is_refused_before_the_run(
    setup: Any, currents: str, rule: str, words: str
) -> None:
    setup.protocol = parse(Protocol, setup.protocol.text.replace(UP, f"{UP}{currents}\n"), "p")
    add_to_protocol(setup, f"ring_down = {{ seconds = 0.1{rule} }}")
    with pytest.raises(InputError, match=words):
        check_request(setup.protocol, setup.specimen, setup.rig)


@pytest.mark.parametrize(
    ("currents", "rule"),
    [
        ("up_and_down = true", ", from_A = 0.3"),
        ("both_polarities = true", ""),
        ("both_polarities = true", ", from_A = -0.2"),
    ],
)
def test_a_ring_down_from_a_current_that_flows_after_the_states_is_accepted(
    setup: Any, currents: str, rule: str
) -> None:
    setup.protocol = parse(Protocol, setup.protocol.text.replace(UP, f"{UP}{currents}\n"), "p")
    add_to_protocol(setup, f"ring_down = {{ seconds = 0.1{rule} }}")
    check_request(setup.protocol, setup.specimen, setup.rig)


def test_creep_frames_last_as_long_as_the_state(setup: Any) -> None:
    text = setup.protocol.text.replace("[settle]", "[settle]\ndwell_s = 3.0")
    setup.protocol = parse(Protocol, f"creep = true\ntransients = {{ frames_per_state = 20 }}\n{text}", "p")
    setup.run()
    with open_dataset(setup.path) as dataset:
        transients = [dataset.transient(state.index) for state in dataset.states]
        points = dataset.set_points()
    for recorded in transients[1:]:
        assert recorded is not None
        assert 15 <= len(recorded.elapsed_s) <= 20
        assert recorded.elapsed_s[-1] >= 2.5
        ratios = recorded.elapsed_s[2:] / recorded.elapsed_s[1:-1]
        assert np.median(ratios) > 1.1  # the times are logarithmically spaced
    assert [point.current_A for point in points] == [0.1, 0.2, 0.3, 0.0]


def test_a_stream_is_read_by_every_reader_and_holds_few_frames_in_memory(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (70, 40, 64, 3), dtype=np.uint8)
    with h5py.File(tmp_path / "s.h5", "w", libver="latest") as file:
        stack = frame_stack(file, "frames", images[0])
        file.swmr_mode = True
        with FrameStream(stack, ring_bytes=3 * images[0].nbytes) as stream:
            for image in images:
                stream.put(image)
                assert stream.waiting <= 3
        with h5py.File(tmp_path / "s.h5", "r", swmr=True) as reader:
            np.testing.assert_array_equal(reader["frames"][()], images[..., ::-1])
    raw = bytearray((tmp_path / "s.h5").read_bytes())
    with h5py.File(tmp_path / "s.h5") as file:
        chunk = file["frames"].id.get_chunk_info(30)
    raw[chunk.byte_offset + 100] ^= 1
    (tmp_path / "s.h5").write_bytes(raw)
    with h5py.File(tmp_path / "s.h5") as file:
        np.testing.assert_array_equal(file["frames"][31], images[31, ..., ::-1])
        with pytest.raises(OSError, match="read"):
            file["frames"][30]


def test_a_stream_reports_the_frames_that_it_could_not_write(tmp_path: Path) -> None:
    image = np.zeros((8, 8), np.uint8)
    with h5py.File(tmp_path / "s.h5", "w", libver="latest") as file:
        stack = frame_stack(file, "frames", image)
        with FrameStream(stack) as stream, pytest.raises(ValueError, match="but the frames before have"):
            stream.put(image[:4])
    with h5py.File(tmp_path / "s.h5", "r") as file:  # the file is open for reading only

        def put_many() -> None:
            with FrameStream(file["frames"]) as stream:
                for _ in range(100):
                    stream.put(image)

        with pytest.raises((OSError, RuntimeError, ValueError)):
            put_many()


def test_a_ring_down_begins_when_the_current_is_reached_and_the_beam_is_at_rest(
    setup: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def noting(owner: Any, name: str, note: Callable[..., str]) -> None:
        original = getattr(owner, name)

        def noted(*arguments: Any, **options: Any) -> Any:
            done.append(note(*arguments))
            return original(*arguments, **options)

        monkeypatch.setattr(owner, name, noted)

    add_to_protocol(setup, "ring_down = { seconds = 0.1, from_A = 0.2, repeats = 2 }")
    noting(Coil, "ramp_to", lambda coil, current_A, *rest: f"ramp to {current_A:g} A")
    noting(Coil, "wait_until_reached", lambda *rest: "reached")
    noting(ring_downs_module, "wait_until_settled", lambda *rest: "at rest")
    noting(Coil, "step_to", lambda coil, current_A: f"step to {current_A:g} A")
    setup.run()
    # The last wait belongs to the step, which measures the current until it is zero.
    one = ["ramp to 0.2 A", "reached", "at rest", "step to 0 A", "reached"]
    assert done[-10:] == one * 2
