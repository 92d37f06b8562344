"""The rotation of the tip during creep is measured without bias, also for a strongly bent beam."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import decay_of
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing_beam import RingingBeam
from eimi_fitting.time.slow_evidence import CreepEvidence, LoadHistory
from eimi_fitting.time.slow_motion import (
    displacement_per_rad,
    modulus_in_pictures,
    shown_rotations,
    slow_rotations,
)

MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="plane-stress", magnet=MAGNET)
REST_MM = np.column_stack([np.linspace(4.0, 29.0, 8), np.zeros(8)])


def test_the_measured_rotation_of_a_bent_beam_is_converted_into_its_true_rotation() -> None:
    beam = RingingBeam(BEAM, Loads.along([5.0]), LAWS["neo-hookean"], np.ones(1))
    per_rad = displacement_per_rad(beam, 46e3, beam.loads, Loads.along([0.0]), REST_MM)
    model, moduli = beam.planar(), np.linspace(44e3, 36e3, 12)
    shapes = model.solve(beam.law, beam.parameters(moduli), beam.loads)
    true = np.radians(model.tip_angle_deg(shapes))[:, 0]
    places = model.positions(shapes, REST_MM)[:, 0]
    time = np.repeat(np.arange(12.0)[:, None], 8, axis=1)
    signals = signals_of(Motion("creep", places, REST_MM, time, np.full(time.shape, 1e-3)))
    measured = np.einsum("npi,pi->n", places, per_rad) / (per_rad**2).sum()
    shown = shown_rotations(beam, 46e3, REST_MM, signals, per_rad)
    assert shown is not None
    assert np.ptp(measured) < 0.9 * np.ptp(true)  # one displacement per rad is not enough
    assert np.ptp(np.interp(true, *shown)) == pytest.approx(np.ptp(measured), rel=3e-3)


def test_a_hanging_beam_without_a_field_shows_its_true_rotation() -> None:
    beam = RingingBeam(BEAM, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))
    time = np.repeat(np.arange(12.0)[:, None], 8, axis=1)
    places = np.repeat(REST_MM[None], 12, axis=0)
    signals = signals_of(Motion("creep", places, REST_MM, time, np.full(time.shape, 1e-3)))
    assert shown_rotations(beam, 46e3, REST_MM, signals, np.ones((8, 2))) is None


def test_few_frames_of_a_beam_that_still_vibrates_have_a_large_uncertainty() -> None:
    beam = RingingBeam(BEAM, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))
    frame_s = np.append(np.arange(0.01, 6.0, 0.01), np.geomspace(6.0, 12.0, 8))
    shape = (REST_MM[:, 0] / 30.0) ** 2
    size = 1.4 * np.exp(-0.1 * frame_s) * np.cos(2 * np.pi * 5.5 * frame_s)
    places = np.repeat(REST_MM[None], len(frame_s), axis=0)
    places[..., 1] += size[:, None] * shape
    places += 1e-3 * np.random.default_rng(1).standard_normal(places.shape)
    time = np.repeat(frame_s[:, None], 8, axis=1)
    motion = Motion("creep", places, REST_MM, time, np.full(time.shape, 1e-3))
    signals = signals_of(motion, 0.0)
    decay = decay_of(signals, "step", 30.0, is_stepped=True)
    per_rad = displacement_per_rad(beam, 46e3, beam.loads, Loads.along([5.0]), REST_MM)
    found = slow_rotations(motion, signals, decay, per_rad)
    assert found is not None
    times, rotation, sigma, _ = found
    late = times > 6.5
    assert late.any()
    assert (np.abs(rotation - rotation[~late].mean()) < 4 * sigma + 1e-3).all()
    assert sigma[late].min() > 0.3 * np.radians(0.5)


@pytest.mark.parametrize("seed", [0, 5])
def test_a_vibration_between_frames_that_are_far_apart_is_part_of_the_uncertainty(seed: int) -> None:
    beam = RingingBeam(BEAM, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))
    per_rad = displacement_per_rad(beam, 46e3, beam.loads, Loads.along([5.0]), REST_MM)
    rng = np.random.default_rng(seed)
    frame_s = np.geomspace(0.1, 12.0, 24) * np.exp(0.02 * rng.standard_normal(24))
    creep = np.radians(0.1) * np.log(frame_s)
    vibration = np.radians(6.0) * np.exp(-0.5 * frame_s) * np.cos(2 * np.pi * 6.1 * frame_s)
    places = REST_MM + (creep + vibration)[:, None, None] * per_rad
    places += 1e-3 * rng.standard_normal(places.shape)
    time = np.repeat(frame_s[:, None], 8, axis=1)
    motion = Motion("creep", places, REST_MM, time, np.full(time.shape, 1e-3))
    found = slow_rotations(motion, signals_of(motion, 0.0), None, per_rad)
    assert found is not None
    times, rotation, sigma, _ = found
    error = rotation - np.radians(0.1) * np.log(times)
    error -= (error / sigma**2).sum() / (1 / sigma**2).sum()
    assert (np.abs(error) < 3.5 * sigma).all()
    assert sigma[-1] < np.radians(0.2)


def test_the_modulus_of_a_bent_beam_follows_from_its_pictures() -> None:
    beam = RingingBeam(BEAM, Loads.along([7.0]), LAWS["neo-hookean"], np.ones(1))
    model = beam.planar()
    places = model.positions(model.solve(beam.law, beam.parameters(np.array([31e3])), beam.loads), REST_MM)[0]
    time = np.repeat(np.arange(12.0)[:, None], 8, axis=1)
    motion = Motion("creep", np.repeat(places, 12, axis=0), REST_MM, time, np.full(time.shape, 1e-3))
    motion.points_mm[:6] = REST_MM
    motion.points_mm[8, 2] = np.nan
    assert modulus_in_pictures(beam, 44e3, motion) == pytest.approx(31e3, rel=0.01)
    straight = RingingBeam(BEAM, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))
    assert modulus_in_pictures(straight, 44e3, motion) == 44e3


def test_a_shift_with_the_squared_amplitude_of_the_vibration_is_no_creep() -> None:
    squares = 0.01 * np.exp(-np.arange(12.0))
    shown = np.linspace(-1.0, 2.0, 5), np.linspace(-1.0, 2.0, 5)
    true, sigma = 0.3 + 1e-5 * np.log(np.arange(1.0, 13.0)), np.full(12, 1e-5)

    def chi2(rotation: np.ndarray) -> float:
        history = LoadHistory(())
        creep = CreepEvidence(history, np.arange(1.0, 13.0), rotation, sigma, squares, "step", shown)
        return float((creep.residuals_at(true[None]) ** 2).sum())

    assert chi2(true) == pytest.approx(0.0, abs=1e-9)
    assert chi2(true + 0.2 * squares) == pytest.approx(1.0, rel=0.1)  # one standard deviation of the prior
    assert chi2(true + 0.2 * squares[::-1]) > 4.0
