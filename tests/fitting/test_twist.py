"""The twist of a beam whose magnetic moment is tilted out of the plane of bending agrees with theory."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from eimi_fitting.beam.twist import torsion_constant_mm4, twist_per_tilt

Array = NDArray[np.float64]

LENGTH_M = 0.026
MOMENT_A_M2 = 0.0229
MODULUS_PA = 46390.0
TORSION = 1e-12 * MODULUS_PA * torsion_constant_mm4(3.0, 5.0)
OUT_OF_PLANE, IN_PLANE = (3e-12 * MODULUS_PA * size / 12 for size in (3 * 5**3, 5 * 3**3))


def straight(stations: int) -> Array:
    # Return S equally spaced points (x, y) on the centre line of a straight beam along x in mm, shape (1, S, 2).
    return np.stack([np.linspace(0, 1e3 * LENGTH_M, stations), np.zeros(stations)], axis=-1)[None]


def test_a_straight_beam_across_the_field_twists_as_a_bar_under_a_couple() -> None:
    field_T, couple = 7e-3, np.array([[-MOMENT_A_M2 * 7e-3, 0.0]])
    twist = twist_per_tilt(straight(21), np.zeros((1, 20)), np.zeros((1, 20, 2)), couple, OUT_OF_PLANE, TORSION)
    assert twist[0, -1] == pytest.approx(-MOMENT_A_M2 * field_T * LENGTH_M / TORSION)
    assert twist[0, 10] == pytest.approx(0.5 * twist[0, -1])


def test_a_bending_force_buckles_the_beam_to_the_side_at_the_load_of_prandtl() -> None:
    # Critical tip force (Prandtl 1899): 4.013 sqrt(A C) / L^2, with the lateral bending stiffness A, the torsional
    # stiffness C and the length L.

    def turns(load: float) -> bool:
        force = load * np.sqrt(OUT_OF_PLANE * TORSION) / LENGTH_M**2
        moment = force * LENGTH_M * (1 - (np.arange(100) + 0.5) / 100)
        couple, forces = np.array([[-1e-13, 0.0]]), np.tile([0.0, force], (1, 100, 1))
        return bool(twist_per_tilt(straight(101), moment[None], forces, couple, OUT_OF_PLANE, TORSION)[0, -1] > 0)

    assert not turns(4.00)
    assert turns(4.03)


def test_a_bent_beam_twists_as_a_rod_in_space() -> None:
    # Reference: the shape of least energy of eight rigid pieces, joined by springs against bending and twist.
    pieces, field = 8, np.array([0.0, 7e-3, 0.0])
    spacing, stiffness = LENGTH_M / pieces, np.array([TORSION, OUT_OF_PLANE, IN_PLANE])

    def rotations(turns: Array) -> list[Rotation]:
        every = [Rotation.identity()]
        for turn in turns.reshape(pieces, 3):
            every.append(every[-1] * Rotation.from_rotvec(turn))
        return every

    def energy(turns: Array, tilt: float) -> float:
        moment = MOMENT_A_M2 * rotations(turns)[-1].apply([1.0, 0.0, tilt])
        elastic = 0.5 * (stiffness * turns.reshape(pieces, 3) ** 2).sum() / spacing
        return float(1e6 * (elastic - moment @ field))

    def solved(tilt: float, start: Array) -> Array:
        return np.asarray(minimize(energy, start, args=(tilt,), method="BFGS", options={"gtol": 1e-5}).x)

    tilt = 0.01
    planar = solved(0.0, np.tile([0.0, 0.0, 0.05], pieces))
    tilted = solved(tilt, planar)
    before, after = rotations(planar), rotations(tilted)
    turn = (after[-1] * before[-1].inv()).as_rotvec()
    expected = turn @ before[-1].apply([1.0, 0.0, 0.0]) / tilt

    # The stations are the ends of the bent rod's pieces; a piece has the direction half-way between its two frames.
    angle = np.array([frame.as_rotvec()[2] for frame in before])
    middle = 0.5 * (angle[1:] + angle[:-1])
    stations = np.zeros((1, pieces + 1, 2))
    stations[0, 1:] = 1e3 * spacing * np.cumsum(np.stack([np.cos(middle), np.sin(middle)], axis=-1), axis=0)
    couple = MOMENT_A_M2 * np.array([[-field[1], field[0]]])
    moment = IN_PLANE * np.diff(angle)[None] / spacing
    twist = twist_per_tilt(stations, moment, np.zeros((1, pieces, 2)), couple, OUT_OF_PLANE, TORSION)
    assert twist[0, -1] == pytest.approx(expected, rel=0.02)
