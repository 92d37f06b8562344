"""A run and a live camera send frames (in shared memory), their descriptions and edges to the page."""

from __future__ import annotations

import io
import json
import os
import queue
import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Frame, Identity, Limits, Reading, SwitchOffFailed
from eimi_lab.acquisition.events import Event, PageGone
from eimi_lab.acquisition.live_view import Live
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.rig import CoilRating
from eimi_lab.config.specimen import load_specimen
from eimi_lab.page import watched_run
from eimi_lab.page.eye import SIZES, edges_in, find_in_frames, light, show_frames
from eimi_lab.page.frame_memory import PLACE_BYTES, FrameMemory, new_memory
from eimi_lab.page.watched_run import Descriptors, WatchedSupply, watched
from eimi_lab.process.pipes import handed_down
from eimi_lab.vision.beam_frame import BeamFrame

ABOUT = {"at_s": 5.0, "set_A": 0.4, "measured_A": 0.5, "on": True, "heat_share": None}


@pytest.fixture
def memory() -> Any:
    descriptor = new_memory()
    yield descriptor
    os.close(descriptor)


@pytest.mark.parametrize(
    "image",
    [
        np.arange(6, dtype=np.uint8).reshape(2, 3),
        np.arange(18, dtype=np.uint8).reshape(2, 3, 3),
        np.arange(6, dtype=np.uint16).reshape(3, 2) * 9000,
        np.arange(24, dtype=np.uint8).reshape(4, 6)[::2, ::-2],
    ],
)
def test_a_frame_is_read_as_it_was_written(memory: int, image: Any) -> None:
    writer, reader = FrameMemory(memory), FrameMemory(memory)
    assert (reader.newest(), reader.read(0)) == (0, None)
    for number in (1, 2, 3):
        writer.write(image + np.array(number, image.dtype), {"number": number})
        frame = reader.read(number - 1)
        assert frame is not None
        assert (frame.number, frame.about, frame.kept, reader.newest()) == (number, {"number": number}, 1, number)
        assert (frame.image.dtype, frame.image.tolist()) == (image.dtype, (image + number).tolist())
        assert reader.read(number) is None


def test_a_frame_that_is_larger_than_its_slot_is_thinned_out(memory: int) -> None:
    rows = np.arange(8200, dtype=np.uint16)
    image = np.broadcast_to(rows[:, None], (8200, 8200))  # 134 MB; a slot has 67 MB
    FrameMemory(memory).write(image, {})
    frame = FrameMemory(memory).read(0)
    assert frame is not None
    assert (frame.kept, frame.image.shape) == (2, (4100, 4100))
    assert np.array_equal(frame.image[:, 7], rows[::2])
    assert frame.image.nbytes <= PLACE_BYTES


def test_a_frame_that_is_overwritten_during_each_attempt_is_not_shown(memory: int) -> None:
    frames = FrameMemory(memory)
    frames.write(np.zeros((2, 2), np.uint8), {})
    place = frames._place(1)
    frames._memory[place + 8 : place + 16] = (7).to_bytes(8, "little")  # the counter after the pixels
    assert frames.read(0) is None
    frames._memory[place + 8 : place + 16] = (1).to_bytes(8, "little")
    assert frames.read(0) is not None


@pytest.fixture
def rig_file(files: Path) -> str:
    (files / "shots").mkdir()
    (files / "rig.toml").write_text(f"""
name = "desk"
calibration = "calibration.toml"
supply = {{ driver = "scpi", address = "tcp:127.0.0.1:9", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
[camera]
driver = "opencv"
source = "{files / "shots"}"
playback = {{ picture_a_state = true, loop = true }}
""")
    return str(files / "rig.toml")


def messages(monkeypatch: pytest.MonkeyPatch, act: Callable[[], None]) -> list[tuple[dict[str, Any], bytes]]:
    # Return the messages (description and JPEG) that `act` writes to standard output.
    output = io.BytesIO()
    monkeypatch.setattr("sys.stdout", SimpleNamespace(buffer=output))
    act()
    monkeypatch.undo()
    text, sent = output.getvalue(), []
    while text:
        about_bytes, picture_bytes = SIZES.unpack(text[:8])
        sent.append((json.loads(text[8 : 8 + about_bytes]), text[8 + about_bytes : 8 + about_bytes + picture_bytes]))
        text = text[8 + about_bytes + picture_bytes :]
    return sent


def closed_pipe(content: bytes) -> int:
    # Return the reading end of a pipe that contains `content` and whose writing end is closed.
    read, write = os.pipe()
    os.write(write, content)
    os.close(write)
    return read


@pytest.mark.parametrize(("on", "field_mT"), [(True, 4.7 * 0.5), (False, 0.0)])
def test_a_frame_is_sent_as_jpeg_with_its_description(
    memory: int, rig_file: str, frame: Any, monkeypatch: pytest.MonkeyPatch, on: bool, field_mT: float
) -> None:
    wide = np.tile(frame(1), (1, 10))  # 1280 px; the page shows at most 960
    FrameMemory(memory).write(wide, {**ABOUT, "on": on})
    bell = closed_pipe(b"\0\0")
    ((about, picture),) = messages(monkeypatch, lambda: show_frames(memory, bell, rig_file))
    os.close(bell)
    assert about == {
        "kind": "frame",
        "seen": 1,
        "size_px": [1280, 96],
        "field_mT": pytest.approx(field_mT),
        **light(wide),
        **ABOUT,
        "on": on,
    }
    assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE).shape == (72, 960)


def test_the_edges_of_the_last_frame_are_sent_even_if_the_run_has_ended(
    memory: int, rig_file: str, files: Path, frame: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = FrameMemory(memory)
    for seed in (1, 2):
        frames.write(frame(seed, 4.0 * seed), ABOUT)
    closed = closed_pipe(b"")
    ((about, picture),) = messages(
        monkeypatch, lambda: find_in_frames(memory, closed, rig_file, str(files / "specimen.toml"))
    )
    os.close(closed)
    assert (about["kind"], about["seen"], picture) == ("edges", 2, b"")
    middles = sorted(np.mean(about[side], axis=0)[0] for side in ("left", "right"))
    assert middles == pytest.approx([64.0, 80.0], abs=0.3)


def test_no_edges_are_sent_without_a_frame(
    memory: int, rig_file: str, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = closed_pipe(b"")
    assert messages(monkeypatch, lambda: find_in_frames(memory, closed, rig_file, str(files / "specimen.toml"))) == []
    os.close(closed)


@pytest.mark.parametrize(("dtype", "most"), [(np.uint8, 255), (np.uint16, 65535)])
def test_the_histogram_counts_each_grey_level_once(dtype: Any, most: int) -> None:
    # A quarter of the pixels is black, a quarter is at half of the range, and half of the pixels is saturated.
    image = np.array([[0, most // 2, most, most]], dtype)
    exposure = light(image)
    expected = [0.25] + [0.0] * 30 + [0.5]
    expected[15] = 0.25
    assert exposure == {"histogram": expected, "saturated_share": 0.5}
    colour = np.zeros((1, 4, 3), dtype)
    colour[..., 1] = image  # the brightest channel counts
    assert light(colour) == exposure


def test_a_pixel_is_saturated_from_998_thousandths_of_the_largest_level() -> None:
    levels = np.array([[int(0.9975 * 65535), int(0.9985 * 65535), 65535, 60000]], np.uint16)
    assert light(levels)["saturated_share"] == 0.5


def test_the_exposure_of_a_large_frame_is_that_of_every_fourth_pixel() -> None:
    large = np.full((1024, 1024), 10, np.uint8)
    large[::4, ::4] = 255
    small = large[:512, :512]
    assert light(large)["saturated_share"] == 1.0
    assert light(small)["saturated_share"] == 1 / 16


@pytest.mark.parametrize(("drawn_px", "names"), [(1.0, []), (3.0, ["DEFOCUS"])])
def test_the_blur_is_stated_always_and_flagged_above_its_limit_only(
    files: Path, texts: dict[str, str], drawn_px: float, names: list[str]
) -> None:
    (files / "below.toml").write_text(texts["calibration"].replace("[64.0, 8.0]", "[99.5, 39.5]"))
    calibration, beam = load_calibration(files / "below.toml"), load_specimen(files / "specimen.toml")
    image = np.full((180, 200), 200.0)
    image[:40] = image[40:120, 92:108] = 40.0
    noise = np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    blurred = np.clip(cv2.GaussianBlur(image, (0, 0), drawn_px) + noise, 0, 255).astype(np.uint8)
    found = edges_in(blurred, calibration, beam, BeamFrame(calibration))
    assert found["blur_px"] == pytest.approx(drawn_px, rel=0.1)
    assert found["blur_limit_px"] == 2.5
    assert abs(found["tip_angle_deg"]) < 3.0 * found["tip_angle_sigma_deg"]
    assert [(flag["name"], flag["value"], flag["limit"]) for flag in found["flags"]] == [
        (name, found["blur_px"], 2.5) for name in names
    ]
    across = sorted(np.mean(found[side], axis=0)[0] for side in ("left", "right"))
    assert across == pytest.approx([91.5, 107.5], abs=0.1)


class Supply:
    limits = Limits(current_A=2.0, voltage_V=10.0)
    measures_current = False
    reads_zero_within_A = 0.07
    without_contact = "it stays on"

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.current_A = 0.0

    def identify(self) -> Identity:
        return Identity("maker", "model", "serial", "firmware")

    def set_voltage(self, voltage_V: float) -> None:
        self.calls.append(("voltage", voltage_V))

    def set_current(self, current_A: float) -> None:
        self.calls.append(("current", current_A))

    def set_output(self, on: bool) -> None:
        self.calls.append(("output", on))

    def output_on(self) -> bool:
        return bool(self.calls) and self.calls[-1] == ("output", True)

    def measure(self) -> Reading:
        return Reading(self.current_A, 1.0)

    def check(self) -> None:
        self.calls.append("check")

    def close(self) -> None:
        self.calls.append("close")


def test_a_watched_supply_passes_every_call_and_remembers_what_the_page_shows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    supply, clock = Supply(), SimulatedClock()
    rig: Any = SimpleNamespace(coil=CoilRating(continuous_current_A=2.0, thermal_time_constant_s=100.0))
    seen = WatchedSupply(supply, clock, rig)
    assert (seen.limits, seen.measures_current, seen.reads_zero_within_A) == (supply.limits, False, 0.07)
    assert (seen.identify(), seen.output_on()) == (supply.identify(), False)
    seen.set_voltage(4.0)
    seen.set_current(2.0)
    clock.sleep(1000.0)
    assert seen.values() == {"set_A": 2.0, "measured_A": 0.0, "on": False, "heat_share": 0.0}  # the output is off
    seen.set_output(True)
    assert seen.output_on()
    seen.set_current(2.0)
    clock.sleep(100.0)
    supply.current_A = 1.9
    assert seen.measure() == Reading(1.9, 1.0)
    seen.check()
    values = seen.values()
    assert values.pop("heat_share") == pytest.approx(1.0 - np.exp(-1.0))  # after one time constant
    assert values == {"set_A": 2.0, "measured_A": 1.9, "on": True}
    monkeypatch.setattr(watched_run, "switch_off", lambda off, at: SimpleNamespace(current_A=0.01))
    assert seen.safe_off() == SimpleNamespace(current_A=0.01)
    clock.sleep(100.0)
    values = seen.values()
    assert values.pop("heat_share") == pytest.approx((1.0 - np.exp(-1.0)) * np.exp(-1.0))  # it cools
    assert values == {"set_A": 0.0, "measured_A": 0.01, "on": False}
    seen.set_current(1.0)
    seen.set_output(False)
    monkeypatch.setattr(watched_run, "switch_off", lambda off, at: None)
    assert seen.safe_off() is None
    assert seen.measured_A == 0.0
    seen.close()
    assert supply.calls == [
        *(("voltage", 4.0), ("current", 2.0), ("output", True), ("current", 2.0)),
        *("check", ("current", 1.0), ("output", False), "close"),
    ]


def test_a_supply_that_is_not_confirmed_off_keeps_its_values(monkeypatch: pytest.MonkeyPatch) -> None:
    flows: list[float | None] = [0.4, None]

    def fails(supply: Any, clock: Any) -> None:
        raise SwitchOffFailed("on", current_A=flows.pop(0))

    monkeypatch.setattr(watched_run, "switch_off", fails)
    rig: Any = SimpleNamespace(coil=None)
    seen = WatchedSupply(Supply(), SimulatedClock(), rig)
    seen.set_current(0.5)
    seen.set_output(True)
    for _ in range(2):  # the second time, no current was measured
        with pytest.raises(SwitchOffFailed):
            seen.safe_off()
        assert seen.values() == {"set_A": 0.5, "measured_A": 0.4, "on": True, "heat_share": None}


def test_frames_of_a_run_are_announced_at_most_40_times_a_second(
    memory: int, monkeypatch: pytest.MonkeyPatch, frame: Any
) -> None:
    # Of 100 frames a second, every third frame is sent.
    times = iter(100.0 + 0.01 * k for k in range(1000))
    monkeypatch.setattr(watched_run, "time", SimpleNamespace(monotonic=lambda: next(times)))
    listened: list[Any] = []
    monkeypatch.setattr(watched_run, "_listen", lambda typed, on_event: listened.append((typed, on_event)))
    bell_read, bell = os.pipe()
    bench: Any = SimpleNamespace(supply=Supply(), clock=SimulatedClock())
    monkeypatch.setattr(watched_run, "replace", lambda bench, supply: SimpleNamespace(supply=supply))
    heard: list[Event] = []
    rig: Any = SimpleNamespace(coil=None)
    with handed_down(memory, bell, bell) as (names, _):
        page = Descriptors.of(",".join(names))
    assert page == Descriptors(memory, bell, bell)
    with watched(page, bench, rig, heard.append) as given:
        assert given.typed() is None
        typed, on_event = listened[0]
        typed.put("p")
        assert (given.typed(), given.typed(), on_event) == ("p", None, heard.append)
        supply: Any = given.bench.supply
        supply.set_current(0.3)
        frames, numbers = FrameMemory(memory), []
        for number in range(300):
            given.show(Live(Frame(frame(1), number, 0.0), 2, 0.3))
            shown = frames.read(frames.newest() - 1)
            assert shown is not None
            numbers.append(shown.about["number"])
        assert sorted(set(numbers)) == list(range(0, 300, 3))
        assert len(os.read(bell_read, 4096)) == 100
        assert shown.about == {
            "at_s": pytest.approx(102.97),
            "rate_Hz": pytest.approx(101.0, abs=1.5),
            "state": 2,
            "number": 297,
            "set_A": 0.3,
            "measured_A": 0.0,
            "on": False,
            "heat_share": None,
        }
    for end in (bell_read, bell):
        os.close(end)


def test_a_run_that_the_page_did_not_start_gets_its_bench_unchanged() -> None:
    bench: Any = object()
    rig: Any = None
    with watched(None, bench, rig, lambda event: None) as given:
        assert given.bench is bench


def test_lines_of_the_page_are_signals_or_typed_lines_and_its_end_stops_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    signals: list[int] = []
    monkeypatch.setattr(watched_run, "signal_main_thread", signals.append)
    monkeypatch.setattr("sys.stdin", io.StringIO(" p \nsignal 2\n\n"))
    typed: queue.SimpleQueue[str] = queue.SimpleQueue()
    heard: list[Event] = []
    watched_run._listen(typed, heard.append)
    assert [typed.get_nowait(), typed.get_nowait(), typed.empty()] == ["p", "", True]
    assert signals == [2, signal.SIGTERM]
    assert heard == [PageGone()]
