"""Each step of the fit of a viscoelastic law agrees with stored reference values for small synthetic measurements."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time import identification, ringing
from eimi_fitting.time.channels import Signals, signals_of
from eimi_fitting.time.decay import NoVibration, decay_of
from eimi_fitting.time.evidence import RestEvidence, RingEvidence, Sag, with_scatter
from eimi_fitting.time.identification import (
    RecordedMotion,
    StaticRun,
    StaticStates,
    _creeps,
    _static_evidence,
    identify_time,
)
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import RingingBeam
from eimi_fitting.time.slow_evidence import SlowEvidence
from eimi_fitting.time.slow_motion import displacement_per_rad, modulus_in_pictures, shown_rotations, slow_rotations
from eimi_fitting.time.small_effects import small_effects
from tests.shared.accepted_numbers import check, described

ACCEPTED = Path(__file__).parent / "accepted"
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0, tip_offset_mm=1.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
NEO = LAWS["neo-hookean"]
YEOH, OF_YEOH = LAWS["yeoh"], np.array([0.5, 0.05, 0.002])
SERIES = Prony(np.array([[0.12, 0.1], [0.2, 0.05], [0.05, 0.02]]), np.array([[0.05, 2.0], [0.02, 0.4], [0.2, 9.0]]))
MODULI_PA = np.array([60e3, 75e3, 52e3])
LOAD_LOGS = np.array([0.0, 0.05, -0.1])


def compare(lines: Iterable[str], name: str, folder: Path, relative: float = 1.1e-5) -> None:
    check(lines, ACCEPTED / name, folder, relative, absolute=1e-9)


def of(value: Any, name: str) -> Iterator[str]:
    # Yield the description of a value; its arrays are divided by a power of ten.
    if isinstance(value, Prony | RingTable | Signals):
        return
    if isinstance(value, np.ndarray) and np.iscomplexobj(value):
        value = np.stack([value.real, value.imag])
    if is_dataclass(value) and not isinstance(value, type):
        value = {part.name: getattr(value, part.name) for part in fields(value)}
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from of(part, f"{name}.{key}")
    elif isinstance(value, list | tuple) and not all(isinstance(part, float | int | str) for part in value):
        for number, part in enumerate(value):
            yield from of(part, f"{name}.{number}")
    elif isinstance(value, np.ndarray | np.floating | float) and np.size(value):
        array = np.atleast_1d(np.asarray(value, float))
        largest = np.abs(array[np.isfinite(array)]).max(initial=0.0)
        power = int(np.floor(np.log10(largest))) if largest > 0 else 0
        yield from described(array / 10.0**power, f"{name} (1e{power})")
    else:
        yield from described(value, name)


class CoarseBeam(RingingBeam):
    # A beam with few elements, so that its tests are quick.

    def planar(self) -> BeamModel:
        return BeamModel(self.specimen, 4, 1, self.specimen.planar_section)


@pytest.fixture(autouse=True)
def _few_elements(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ringing, "_SOLID", (5, 1))
    monkeypatch.setattr(ringing, "_FINE_ACROSS", 2)
    monkeypatch.setattr(identification, "RingingBeam", CoarseBeam)


def beam(section: str, field_mT: float, law: str = "neo-hookean", hanging_N: float = 0.0) -> RingingBeam:
    loads = Loads.along([field_mT], 70.0, 10.0, tip_force_N=hanging_N)
    shape = OF_YEOH if law == "yeoh" else np.ones(1)
    return CoarseBeam(replace(BEAM, section=section), loads, LAWS[law], shape, hanging_N)  # type: ignore[arg-type]


def relaxing(s: np.ndarray) -> np.ndarray:
    return np.asarray(SERIES.complex_ratio(s) / SERIES.long_term[:, None])


@pytest.mark.parametrize(
    ("section", "law", "field_mT", "hanging_N"),
    [("solid", "neo-hookean", 1.5, 0.0), ("plane-stress", "yeoh", 0.0, 0.003)],
)
def test_the_vibrations_of_a_beam_have_the_accepted_rates(
    section: str, law: str, field_mT: float, hanging_N: float, tmp_path: Path
) -> None:
    table = RingTable(beam(section, field_mT, law, hanging_N), 48e3)
    ring = RingEvidence.of(table, decay_of(signals_of(flick()), "flick", 30.0, is_stepped=False))
    lines = [
        *of(table.range_Pa, "range_Pa"),
        *of(table._correction, "correction"),
        *of(table.solid_over_planar, "solid over planar"),
        *of(table.planar_over_solid_modulus, "planar over solid modulus"),
        *of(table.fixed_weight_log, "fixed weight"),
        *of(table.roots(np.log([47e3, 90e3, 15e3]), relaxing, load_log=LOAD_LOGS), "rates"),
        *of(table.roots(np.log([47e3, 90e3, 15e3]), relaxing, 1), "lowest rates"),
        *of(table.effects({"width": 0.03, "coil": 0.01, "gravity": 2.0, "density": 0.0}), "effects"),
        *of(ring, "ring"),
        *of(ring.residuals(MODULI_PA, SERIES, LOAD_LOGS), "residuals"),
        *of(ring.effects({"depth": 0.04, "coil": 0.01}), "effects on residuals"),
        *of(table.beam.modulus_at(7.0), "modulus at 7 Hz"),
        *of(small_effects(table.beam.specimen, table.beam.loads, 5.0, 0.1, 1.9, 0.01), "small effects"),
    ]
    if section != "solid":
        lines += of(table.solid_over_stated_modulus(), "solid over stated modulus")
    compare(lines, f"vibrations, {section}.txt", tmp_path)


def motion(across: np.ndarray, along: np.ndarray, time: np.ndarray, **fields_of_motion: Any) -> Motion:
    # Return the motion of five points, with noise: `across` and `along` are the displacements of the tip in mm.
    x = np.linspace(6.0, 30.0, 5)
    share = (x / 30.0) ** 2 * (1.5 - 0.5 * x / 30.0)
    noise = 0.004 * np.random.default_rng(5).standard_normal((len(time), 5, 2))
    places = np.stack([x + np.outer(along, share**2), np.outer(across, share)], axis=-1) + noise
    rest = np.column_stack([x, 0 * x])
    times = np.repeat(time[:, None], 5, axis=1)
    given = {"label": "flick", "exposure_s": 0.004, **fields_of_motion}
    return Motion(given.pop("kind", "ring_down"), places, rest, times, np.full(times.shape, 0.004), **given)


def vibration(time: np.ndarray, frequency_Hz: float, loss: float, size_mm: float, phase: float = 0.0) -> np.ndarray:
    omega = 2 * np.pi * frequency_Hz
    late = np.maximum(time, 0.0)
    return np.asarray(size_mm * np.exp(-0.5 * loss * omega * late) * np.cos(omega * late + phase))


def flick(frames: int = 260) -> Motion:
    time = np.arange(frames) / 90.0
    swing = vibration(time - 0.1, 7.0, 0.11, 1.3) + vibration(time - 0.1, 33.0, 0.16, 0.15, 0.4)
    return motion(swing - 0.3 * np.exp(-time), -0.02 * swing**2, time)


def with_gaps() -> Motion:
    one = flick()
    places, times = one.points_mm.copy(), one.time_s.copy()
    places[40:55, 1], places[100, 3] = np.nan, places[100, 3] + 0.07
    places[30] = np.nan
    times += np.arange(5) * 1e-4 + 2e-7 * np.arange(len(times))[:, None] * np.arange(5)  # a rolling shutter
    return replace(one, points_mm=places, time_s=times)


def pushed_again() -> Motion:
    time = np.arange(420) / 90.0
    swing = np.where(time < 3.0, vibration(time, 5.2, 0.1, 1.2), vibration(time - 3.0, 5.2, 0.1, 1.1, 0.2))
    return motion(swing, 0.0 * time, time)


def touched() -> Motion:
    time = np.arange(500) / 90.0
    swing = vibration(time, 5.2, 0.08, 1.3)
    swing[:70] += 0.3 * np.sin(2 * np.pi * 2.1 * time[:70]) * np.hanning(70)
    return motion(swing, 0.0 * time, time)


def changing() -> Motion:
    time = np.arange(500) / 90.0
    early = 5.0 * (time + 0.04 * (1 - np.exp(-1.6 * time)) / 1.6)
    return motion(1.4 * np.exp(-0.8 * time) * np.cos(2 * np.pi * early), 0 * time, time)


def held_late() -> Motion:
    time = np.arange(600) / 90.0
    first = vibration(time, 5.0, 0.05, 1.4)
    late = vibration(time - 3.2, 5.6, 0.25, 1.4 * np.exp(-0.25 * np.pi * 3.2))
    return motion(np.where(time < 3.2, first, late), 0 * time, time)


def too_large() -> Motion:
    time = np.arange(400) / 90.0
    return motion(vibration(time, 5.2, 0.1, 4.0), 0 * time, time)


def rare_frames() -> Motion:
    time = np.concatenate([np.arange(200) / 90.0, 2.2 + np.geomspace(0.1, 30.0, 40)])
    return motion(vibration(time, 5.2, 0.12, 1.2) - 0.2 * np.log1p(time), 0 * time, time)


def swinging(other_Hz: float, size_mm: float) -> Motion:
    time = np.arange(700) / 90.0
    swing = vibration(time, 5.0, 0.05, 1.0) + vibration(time, other_Hz, 0.03, size_mm, 0.7)
    return motion(swing, 0 * time, time, hanging_N=0.02)


MOTIONS = {
    "flick": (flick, False),
    "with gaps": (with_gaps, False),
    "pushed again": (pushed_again, False),
    "touched": (touched, True),
    "changing": (changing, True),
    "held late": (held_late, True),
    "too large": (too_large, False),
    "rare frames": (rare_frames, True),
    "swinging near": (lambda: swinging(5.6, 0.6), False),
    "swinging at half": (lambda: swinging(2.6, 0.15), False),
    "hanging at rest": (lambda: replace(flick(400), hanging_N=0.02), False),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_a_ring_down_has_the_accepted_vibrations(name: str, tmp_path: Path) -> None:
    make, is_stepped = MOTIONS[name]
    recorded = make()
    signals = signals_of(recorded, 0.0 if is_stepped else -np.inf)
    lines = [line for part in ("filled", "sigma_mm", "channels_mm") for line in of(getattr(signals, part), part)]
    lines += of(signals.reduced @ signals.patterns, "reduced")
    try:
        decay = decay_of(signals, name, 30.0, is_stepped=is_stepped, hangs=recorded.hanging_N > 0)
        lines += of(decay, "decay")
    except NoVibration as error:
        lines.append(str(error))
    compare(lines, f"{name}.txt", tmp_path)


PLACES = np.column_stack([np.linspace(6.0, 30.0, 5), np.array([0.0, 0.5, -0.5, 1.0, 0.0])])


def creeping(field_mT: float, before: tuple[float, ...], frequency_Hz: float) -> RecordedMotion:
    # Return the creep of a beam after a step of the field, with a vibration at its start.
    bent = beam("plane-stress", field_mT)
    model = bent.planar()
    time = np.concatenate([np.arange(-20, 240) / 90.0, np.geomspace(2.8, 40.0, 40)])
    late = np.maximum(time, 1e-3)
    moduli = np.where(time > 0, 96e3 / (1 - 0.12 * np.exp(-late / 1.5)), 120e3)
    loads = Loads.along([field_mT, before[-1]], 70.0, 10.0)
    shapes = model.solve(bent.law, bent.parameters(np.geomspace(80e3, 140e3, 6)), loads)
    places = model.positions(shapes, PLACES)  # (moduli, states, points, 2)
    shares = (np.log(moduli) - np.log(80e3)) / np.log(70 / 40) * 5
    node = np.minimum(shares.astype(int), 4)
    rest = (shares - node)[:, None, None]
    now = (1 - rest) * places[node, 0] + rest * places[node + 1, 0]
    now = np.where((time > 0)[:, None, None], now, places[3, 1])
    swing = np.where(time > 0, vibration(time, frequency_Hz, 0.12, 0.9), 0.0)
    noise = 0.004 * np.random.default_rng(7).standard_normal(now.shape)
    now = now + noise + np.outer(swing, (PLACES[:, 0] / 30) ** 2)[..., None] * np.array([0.05, 1.0])
    times = np.repeat(time[:, None], 5, axis=1)
    recorded = Motion("creep", now, PLACES, times, np.full(times.shape, 0.004), label=f"step to {field_mT:g} mT")
    earlier = tuple((-30.0 * (len(before) - i), Loads.along([one], 70.0, 10.0)) for i, one in enumerate(before))
    return RecordedMotion(recorded, bent.loads, earlier)


CREEPS = {"up": creeping(2.0, (0.0, 0.8), 7.4), "down": creeping(0.0, (2.0,), 7.0)}
STATIC = StaticStates(
    (
        StaticRun(Loads.along([0.0, 2.5], 70.0, 10.0), np.array([-1.0, 10.0]), np.array([10.0, 22.0])),
        StaticRun(Loads.along([1.6], 70.0, 10.0), np.array([5.0]), np.array([400.0])),
    ),
    92e3,
    4e-3,
    {"scale": 0.004},
)


def test_the_slow_motion_after_a_step_has_the_accepted_rotations(tmp_path: Path) -> None:
    lines: list[str] = []
    for name, recorded in CREEPS.items():
        bent = CoarseBeam(BEAM, recorded.loads, NEO, np.ones(1))
        signals = signals_of(recorded.motion, 0.0)
        decay = decay_of(signals, name, 30.0, is_stepped=True)
        before = recorded.before[-1][1]
        per_rad = displacement_per_rad(bent, 96e3, recorded.loads, before, PLACES)
        lines += [
            *of(per_rad, f"{name}.per rad"),
            *of(modulus_in_pictures(bent, 104e3, recorded.motion), f"{name}.modulus in pictures"),
            *of(shown_rotations(bent, 96e3, PLACES, signals, per_rad), f"{name}.shown"),
            *of(slow_rotations(recorded.motion, signals, decay, per_rad), f"{name}.slow"),
            *of(slow_rotations(recorded.motion, signals, None, per_rad), f"{name}.slow without a decay"),
            *of(slow_rotations(recorded.motion, signals, replace(decay, to_s=1.0), per_rad), f"{name}.other frames"),
        ]
    flat = beam("plane-stress", 0.0)
    level = replace(flat, loads=replace(flat.loads, gravity=0 * flat.loads.gravity))
    pulled = replace(level.loads, tip_force_N=np.array([[1e-3, 4e-3]]))
    lines += of(displacement_per_rad(level, 96e3, level.loads, pulled, PLACES), "per rad without a load")
    lines += of(displacement_per_rad(level, 96e3, level.loads, level.loads, PLACES), "per rad without a step")
    compare(lines, "slow motion.txt", tmp_path)


def test_the_residuals_of_creep_and_of_static_states_are_accepted(tmp_path: Path) -> None:
    analysed = [
        (one, decay_of(signals_of(one.motion, 0.0), name, 30.0, is_stepped=True)) for name, one in CREEPS.items()
    ]
    creeps = _creeps([*analysed, (replace(CREEPS["up"], before=()), None)], BEAM, NEO, np.ones(1), 100e3)
    static = _static_evidence(STATIC, BEAM, NEO, np.ones(1))
    assert static is not None
    slow = SlowEvidence(creeps, static)
    sources = {"width": 0.02, "moment": 0.02, "clamp": 0.05, "scale": 0.003, "gravity": 1.0}
    lines = [
        *of(creeps, "creeps"),
        *of(static.runs, "static"),
        *of(static.age_s, "age"),
        *of(static.apparent_log(2 * MODULI_PA, SERIES, LOAD_LOGS), "apparent"),
        *of(slow.residuals(2 * MODULI_PA, SERIES, LOAD_LOGS), "residuals"),
        *of(SlowEvidence(creeps[:1], None).residuals(2 * MODULI_PA, SERIES, LOAD_LOGS), "residuals of one"),
        *of(creeps[0].predicted(2 * MODULI_PA, SERIES, LOAD_LOGS), "predicted"),
        *of(slow.effects(sources), "effects"),
    ]
    compare(lines, "creep and static states.txt", tmp_path)


def test_a_viscoelastic_law_has_the_accepted_values(tmp_path: Path) -> None:
    stated = [
        StatedSource("width", 0.02, "specimen"),
        StatedSource("moment", 0.02, "specimen"),
        StatedSource("coil", 0.01, "coil"),
        StatedSource("clamp", 0.05, "calibration"),
    ]
    still = RecordedMotion(replace(flick(), lost_frames=2), Loads.along([0.0], 70.0, 10.0))
    again = replace(
        still,
        motion=replace(
            motion(vibration(np.arange(250) / 90.0, 7.05, 0.12, 1.0), np.zeros(250), np.arange(250) / 90.0),
            label="again",
        ),
    )
    law = identify_time(
        NEO,
        np.array([95e3]),
        BEAM,
        [still, CREEPS["down"], again],
        stated,
        replace(STATIC, runs=STATIC.runs[:1]),
        seed=3,
        most_terms=2,
    )
    compare(of(replace(law, wall_s=0.0), "law"), "viscoelastic law.txt", tmp_path, relative=1e-4)


def test_the_modulus_at_rest_and_repeated_ring_downs_have_the_accepted_numbers(tmp_path: Path) -> None:
    heavy = replace(BEAM, length_mm=40.0)
    level = CoarseBeam(heavy, Loads.along([0.0], 70.0, -60.0), NEO, np.ones(1))
    table = RingTable(level, 95e3)
    model, rest = level.planar(), np.column_stack([np.linspace(10.0, 40.0, 5), np.zeros(5)])
    sagged = model.positions(model.solve(NEO, np.array([[82e3]]), level.loads), rest)[0, 0]
    one = flick()
    fallen = replace(one, rest_mm=rest, points_mm=one.points_mm - PLACES[:, :1] * [1.0, 0.0] + sagged)
    decays = [
        replace(decay_of(signals_of(flick(frames)), f"{frames}", 40.0, is_stepped=False)) for frames in (260, 200)
    ]
    sag = Sag.of(table, fallen, decays[0])
    assert sag is not None
    rest_evidence = RestEvidence.of(sag, table)
    assert rest_evidence is not None
    higher = replace(decays[1].modes[0], frequency_Hz=7.03, loss=0.112)
    decays[1] = replace(decays[1], modes=(higher,))
    other = RingTable(level, 96e3)
    rings = [RingEvidence.of(table, decays[0]), RingEvidence.of(other, decays[1]), RingEvidence.of(table, decays[1])]
    lines = [
        *of(sag, "sag"),
        *of(sag.doubts(decays[0], 40.0), "doubts"),
        *of(rest_evidence, "at rest"),
        *of(rest_evidence.residuals(2 * MODULI_PA, SERIES, LOAD_LOGS), "residual at rest"),
        *of([[ring.inflation, ring.repeats] for ring in with_scatter(rings)], "scatter"),
    ]
    compare(lines, "at rest and repeated.txt", tmp_path)


def test_joined_loads_keep_every_kind_of_load_in_each_state() -> None:
    alone = Loads.along([2.0, 1.0], 70.0, 10.0, tip_force_N=[0.01, 0.02], pressure_Pa=[3.0, 4.0])
    behind = replace(Loads.along([0.5], 70.0, 10.0), pressure_Pa=5.0).plus(UniformField(np.array([[2e-4, 3e-4]])))
    joined = Loads.joined([alone, behind])
    assert len(joined) == 3
    for k, (part, state) in enumerate([(alone, 0), (alone, 1), (behind, 0)]):
        expected = np.concatenate([part.state(state), np.zeros(0 if part.others else 2)])
        assert joined.state(k).tolist() == expected.tolist()


def test_a_stronger_coil_leaves_the_background_field_of_a_ring_down_unchanged() -> None:
    level = CoarseBeam(BEAM, Loads.along([1.0], 70.0, 10.0), NEO, np.ones(1))
    background = UniformField(np.array([[2e-3, 1e-3]]))
    with_background = replace(level, loads=level.loads.plus(background))
    table = RingTable(with_background, 60e3)
    stronger = replace(level, loads=Loads.along([1.1], 70.0, 10.0).plus(background))
    expected = np.log(stronger.undamped_Hz(60e3)) - np.log(with_background.undamped_Hz(60e3))
    assert table.effects({"coil": 0.1})["coil"][0] == pytest.approx(expected, rel=1e-6, abs=1e-9)
