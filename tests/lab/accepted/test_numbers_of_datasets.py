"""Beam motions, coil heating, field per current and checksums, computed from data of a run, equal stored values."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_fitting.time.measured import Motion
from eimi_lab.acquisition.heating import Warming, _stages, hottest
from eimi_lab.acquisition.ring_downs import frame_times
from eimi_lab.acquisition.transients import Transient
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.protocol import Conditioning, Protocol, RingDown, Transients, load_protocol
from eimi_lab.config.rig import CoilRating
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog
from eimi_lab.dataset.measured_field import field_line
from eimi_lab.dataset.measured_heating import _heats, measured_heating
from eimi_lab.dataset.moving import flicks
from eimi_lab.dataset.moving.beam_modes import cantilever_modes, modal_amplitudes_mm, tip_angles_deg
from eimi_lab.dataset.moving.clicked_line import clicked_calibration, with_measured_axis
from eimi_lab.dataset.moving.film import Film
from eimi_lab.dataset.moving.filmed_motion import points_of_film
from eimi_lab.dataset.moving.free_motion import free_motion, free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.repair.checksums import fletcher32, flipped_bit, flipped_bit_of_chunk, lookup3
from eimi_lab.dataset.tracked.axes import Placing, place
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.dataset.upright import turn
from tests.shared.accepted_numbers import check, described

ACCEPTED = Path(__file__).parent / "datasets"
SPECIMEN = load_specimen("type1")
Array = NDArray[np.float64]
TILTED = Calibration(
    pixels_per_mm=8.0, clamp_midpoint_px=(52.0, 41.0), axis_angle_deg=77.0, gravity_angle_deg=85.0,
    coil_constant_mT_per_A=4.7, field_angle_deg=-8.0,
)  # fmt: skip


def swinging(begins: tuple[float, ...], *, frames: int = 900, drift: float = 0.0, noise: float = 0.0) -> Array:
    # Return three points of a beam in frames that are 0.01 s apart, which is pushed at some times.
    time_s = 0.01 * np.arange(frames)
    moved = drift * np.sin(0.4 * time_s)
    for number, at_s in enumerate(begins):
        after = np.maximum(time_s - at_s, 0.0)
        moved = np.where(time_s >= at_s, drift * np.sin(0.4 * time_s), moved)
        moved += (time_s >= at_s) * (9.0 - 2.0 * number) * 0.5 ** (after / 0.6) * np.cos(2 * np.pi * 4.7 * after)
    moved += np.random.default_rng(5).normal(0.0, 1.0, frames) * noise
    places = np.zeros((frames, 3, 2))
    places[..., 0] = [10.0, 20.0, 29.0] - 0.01 * np.abs(moved)[:, None]
    places[..., 1] = np.outer(moved, [0.2, 0.6, 1.0]) + np.array([0.1, 0.2, 0.4])
    return places


def flicked() -> Iterator[str]:
    time_s = 0.01 * np.arange(900)
    for name, places in (
        ("two", swinging((1.0, 5.0))),
        ("three with noise", swinging((0.7, 3.5, 6.2), noise=0.05)),
        ("two on a drift", swinging((1.2, 5.4), drift=6.0, noise=0.01)),
        ("one", swinging((2.0,), noise=0.02)),
    ):
        places[40:43, 2] = np.nan
        yield from described([list(part) for part in flicks.parts_of(time_s, places)], f"parts of {name}")
        moved: Any = flicks._deflection(places)
        yield from described(moved, f"deflection of {name}")
        for frames in (21, 30):
            yield from described(flicks._white_noise(moved, frames), f"noise of {name} beside {frames}")
        yield from described(float(flicks._period(moved, 100.0)), f"period of {name}")


def described_modes() -> Iterator[str]:
    yield from described(cantilever_modes(np.linspace(0.05, 1.0, 9)), "modes")
    places = swinging((0.1,), frames=40, noise=0.3)
    rest = np.array([[10.0, 0.1], [20.0, -0.2], [29.0, 0.4]])
    time_s = np.repeat(0.01 * np.arange(40)[:, None], 3, axis=1)
    motion = Motion("ring_down", places, rest, time_s, np.full((40, 3), 0.02))
    yield from described(modal_amplitudes_mm(motion, 30.0), "amplitudes")
    yield from described(tip_angles_deg(motion), "tip angles")


def described_films() -> Iterator[str]:
    along = np.linspace(1.5, 29.0, 11)
    random = np.random.default_rng(7)
    middle = np.empty((9, 11, 2))
    middle[..., 0] = 52.0 + 8.0 * np.cos(1.3) * along + random.normal(0.0, 0.4, (9, 11))
    middle[..., 1] = 41.0 + 8.0 * np.sin(1.3) * along + random.normal(0.0, 0.4, (9, 11))
    middle[2, 4] = np.nan
    film = Film(along, middle, middle - 5.0, middle + 5.0)
    points = points_of_film(film, TILTED, SPECIMEN, 0.02 * np.arange(9) ** 1.1, 2e-5, (0.3, 0.9, 12.0))
    yield from described(points, "points")
    facts = {"rate": MotionFacts(kind="ring_down", exposure_s=0.004, hanging_N=0.1), "creep": MotionFacts(kind="creep")}
    facts["released"] = MotionFacts(kind="ring_down", released_s=0.33, removed_N=0.05)
    places = swinging((0.3,), frames=60, noise=0.1)
    time_s = np.delete(0.01 * np.arange(61), 50)[:, None] + [0.0, 0.001, 0.003]
    for name, fact in facts.items():
        motion = free_motion(places, np.ones((3, 2)), time_s, np.full((60, 3), 0.02), fact, "film")
        yield from described(motion, f"motion by {name}")
    places = swinging((1.0, 5.0), noise=0.02)
    times = np.repeat(0.01 * np.arange(900)[:, None], 3, axis=1)
    motions = free_motions(places, np.ones((3, 2)), times, np.full((900, 3), 0.02), facts["rate"], "film")
    yield from described(motions, "motions of two flicks")


def described_clicks() -> Iterator[str]:
    for name, points in (
        ("two", [(60.0, 50.0), (66.0, 290.0)]),
        ("two aslant", [(60.0, 50.0), (160.0, 250.0)]),
        ("four", [(60.0, 50.0), (130.0, 66.0), (195.0, 100.0), (255.0, 160.0)]),
    ):
        made = clicked_calibration(points, SPECIMEN, None, "film")
        yield from described((made.pixels_per_mm, made.axis_angle_deg, made.uncertainty), f"calibration of {name}")
        along = np.linspace(1.0, 30.0, 12)
        share = along / 30.0
        across = 12.0 * share**2 * (3.0 - share) + 2.0
        direction = np.radians(made.axis_angle_deg + 2.0)
        rest = np.array(points[0]) + np.outer(made.pixels_per_mm * along, [np.cos(direction), np.sin(direction)])
        rest += np.outer(across, [-np.sin(direction), np.cos(direction)])
        rest[3] = np.nan
        for loaded in (False, True):
            found = with_measured_axis(made, rest, along, loaded)
            yield from described((found.clamp_midpoint_px, found.axis_angle_deg), f"corrected {name}, loaded {loaded}")


def described_heats() -> Iterator[str]:
    time_s = np.array([0.0, 12.0, 30.0, 31.0, 55.0, 90.0, 140.0, 141.0, 200.0])
    state = np.array([0, 1, 1, 2, 3, 3, 4, 4, 4])
    current_A = np.array([0.0, 0.8, 1.4, 1.1, 0.3])
    yield from described(_heats(time_s, current_A[state] ** 2, np.array([20.0, 70.0])), "heats")
    sensor = LoggedSensor("coil", "PT100", "coil_temperature", "degC", 1.0, None, None)
    random = np.random.default_rng(3)
    for factor in (0.4, 1.0, 2.5):
        heat = _heats(time_s, (current_A[state] / 1.2) ** 2, np.array([60.0 * factor]))[0]
        value = 21.0 + 33.0 * heat + random.normal(0.0, 0.3, len(heat))
        log = SensorLog(sensor, state, time_s, value, np.full(len(heat), 0.1))
        yield from described(measured_heating(log, current_A, 1.2, 60.0), f"heating with {factor:g} times the constant")
    base = load_protocol("dragon_skin_10")
    slow = base.ramp.model_copy(update={"rate_A_per_s": 0.013})
    for name, changes in (
        ("as it is", {}),
        ("with a slow ramp", {"ramp": slow}),
        ("with cycles", {"conditioning": Conditioning(cycles=3, current_A=1.9)}),
        ("with ring-downs", {"ring_down": RingDown(seconds=9.0, repeats=4, from_A=2.4)}),
        ("with transients", {"transients": Transients(frames_per_state=200)}),
    ):
        protocol: Protocol = base.model_copy(update=changes)
        rating = CoilRating(continuous_current_A=1.5, thermal_time_constant_s=70.0)
        yield from described(hottest(protocol, rating), f"hottest {name}")
        yield from described(list(_stages(protocol))[-4:], f"stages {name}")
    warming = Warming(CoilRating(continuous_current_A=1.5, thermal_time_constant_s=70.0))
    for now_s, current in ((5.0, 1.2), (40.0, -2.0), (75.0, 0.5)):
        warming.flows(now_s, current)
        yield from described([warming.share(now_s), warming.share(now_s + 13.0)], f"warming at {now_s:g} s")


def described_lines() -> Iterator[str]:
    current = np.array([0.0, 0.2, 0.2, 0.5, 0.9, 0.9, np.nan])
    reading = np.array([0.31, 1.22, 1.27, 2.66, 4.51, 4.56, 1.0])
    reported = np.array([0.02, 0.03, np.nan, 0.05, 0.04, 0.02, 0.01])
    for name, at_magnet, sigma, share in (
        ("scatter", 1.0, 0.001, None), ("stated", -1.3, 0.2, 0.01), ("reported", 0.8, None, None),
    ):  # fmt: skip
        sensor = LoggedSensor("hall", "F41", "field", "mT", at_magnet, sigma, share)
        yield from described(field_line(sensor, current, reading, reported), f"line by {name}")
    yield from described(field_line(sensor, [0.0, 0.5], [0.1, 2.4]), "line of two")


def described_times() -> Iterator[str]:
    class Coil:
        changed_s, asked_A = 2.0, 0.4

    for budget, lasts_s in ((4, 20.0), (7, 3.0)):
        kept: Any = Transient(budget, lasts_s, Coil())  # type: ignore[arg-type]
        for at_s in 2.0 + 0.05 * np.arange(500):
            kept.see(Frame(np.zeros((1, 1)), 0, 0.0), float(at_s))
        times = [[moment.time_s, moment.elapsed_s, moment.set_A] for moment in kept.moments]
        yield from described(np.array(times), f"transient of {budget} frames")
    stamped = np.array([5.0, 5.011, 5.02, 5.033, 5.04])
    for name, arrived in (("near", stamped + np.array([7.02, 7.01, 7.03, 7.015, 7.05])), ("far", stamped * 2.0)):
        yield from described(np.array(frame_times(arrived, stamped)), f"times {name}")


def described_places() -> Iterator[str]:
    random = np.random.default_rng(9)
    places = random.normal(20.0, 6.0, (4, 3, 3))
    sigma = np.abs(random.normal(0.2, 0.05, (4, 3)))
    tracks = Tracks(names=("a", "b", "c"), frames=np.arange(3, 7), places=places, sigma=sigma, unit="cm")
    placing = Placing(clamp=(1.5, -2.5), axis_deg=33.0, rest=5, plane="zx", unit="cm")
    yield from described(place(tracks, placing, "tracks"), "tracked in space")
    flat = Tracks(names=("a", "b", "c"), frames=np.arange(3, 7), places=10.0 * places[..., :2], image_axes=True)
    yield from described(place(flat, Placing(calibration=TILTED, rest=3, sigma=0.4), "tracks"), "tracked in pictures")
    for gravity_deg in (None, 12.0, -70.0):
        yield from described(turn(None, gravity_deg), f"turn with gravity at {gravity_deg}")
        yield from described(turn(TILTED, gravity_deg), f"turn of a calibration with gravity at {gravity_deg}")


def described_checksums() -> Iterator[str]:
    block = bytes(np.random.default_rng(11).integers(0, 256, 3000, dtype=np.uint8))
    for length in (1, 2, 5, 11, 12, 13, 24, 25, 146, 1300):
        yield f"lookup3 of {length}: {lookup3(block[:length]):08x}"
    for length in (1, 2, 3, 7, 1023, 1024, 1025, 2999):
        yield f"fletcher32 of {length}: {fletcher32(block[:length]):08x}"
    for at, bit in ((0, 0), (3, 7), (140, 4), (259, 1)):
        spoilt = bytearray(block[:260])
        spoilt[at] ^= 1 << bit
        yield f"bit {bit} of byte {at}: {flipped_bit(bytes(spoilt), lookup3(block[:260]))}"
    raw = block[:261] + fletcher32(block[:261]).to_bytes(4, "little")
    for at, bit in ((0, 0), (1, 7), (200, 3), (260, 6), (262, 2), (264, 7)):
        spoilt = bytearray(raw)
        spoilt[at] ^= 1 << bit
        yield f"bit {bit} of byte {at} of a chunk: {flipped_bit_of_chunk(bytes(spoilt))}"


PARTS = {
    "flicks": flicked,
    "modes": described_modes,
    "films": described_films,
    "clicks": described_clicks,
    "heats": described_heats,
    "lines": described_lines,
    "times": described_times,
    "places": described_places,
    "checksums": described_checksums,
}


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_numbers_of_a_run_are_the_accepted_ones(part: str, tmp_path: Path) -> None:
    check(PARTS[part](), ACCEPTED / f"{part}.txt", tmp_path, relative=2e-5, absolute=1e-9)
