"""Frequencies and damping of small vibrations agree with Euler-Bernoulli beams and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.modal_motion import complex_roots
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

MU_PA = 46e3
DEPTH_MM = 5.0
NO_LOAD = Loads.along([0.0], gravity_angle_deg=None)
TYPE_1 = Specimen(
    length_mm=30.0,
    width_mm=3.0,
    depth_mm=5.0,
    density_kg_m3=1070.0,
    section="plane-stress",
    magnet=Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0),
)


def thin(length_mm: float, magnet_density: float | None) -> Specimen:
    magnet = magnet_density and Magnet(2.0, 1.0, DEPTH_MM, 0.0, magnet_density)
    return Specimen(length_mm, 1.0, DEPTH_MM, 1000.0, section="plane-stress", magnet=magnet or None)


def euler_bernoulli_Hz(specimen: Specimen, tip_mass_kg: float) -> Array:
    # Return the three lowest frequencies (Hz) of a cantilever with a rigid body at its tip, shape (3,).
    magnet, width, depth = specimen.magnet, 1e-3 * specimen.width_mm, 1e-3 * specimen.depth_mm
    length, line = 1e-3 * specimen.flexible_length_mm, specimen.density_kg_m3 * width * depth
    stiffness = 3 * MU_PA * depth * width**3 / 12
    size = 1e-3 * magnet.length_mm if magnet else 0.0
    of_magnet = magnet.density_kg_m3 * size * width * depth if magnet else 0.0
    mass = of_magnet + tip_mass_kg
    arm = (0.5 * size * of_magnet + size * tip_mass_kg) / mass if mass else 0.0
    rotary = of_magnet * (size**2 + width**2) / 12 + of_magnet * (0.5 * size) ** 2 + tip_mass_kg * size**2

    def determinant(beta: float) -> float:
        omega2, x = stiffness * beta**4 / line, beta * length
        c, s, ch, sh = np.cos(x), np.sin(x), np.cosh(x), np.sinh(x)
        shapes = np.array([[c - ch, s - sh], [-s - sh, c - ch], [-c - ch, -s - sh], [s - sh, -c - ch]])
        w, slope, bend, shear = (row * beta**k for k, row in enumerate(shapes))
        moment = stiffness * bend - omega2 * (rotary * slope + mass * arm * w)
        force = stiffness * shear + omega2 * mass * (w + arm * slope)
        return float((moment[0] * force[1] - moment[1] * force[0]) / ch**2)

    grid = np.linspace(0.05, 12, 2400) / length
    values = [determinant(b) for b in grid]
    roots = [brentq(determinant, *ends) for ends, signs in zip(pairwise(grid), pairwise(values), strict=True)
             if signs[0] * signs[1] < 0][:3]  # fmt: skip
    return np.array(roots) ** 2 * np.sqrt(stiffness / line) / (2 * np.pi)


@pytest.mark.parametrize("length_mm", [50.0, 90.0])
@pytest.mark.parametrize(("magnet_density", "tip_mass_kg"), [(None, 0.0), (7500.0, 0.0), (7500.0, 4e-4), (None, 2e-4)])
def test_frequencies_are_those_of_a_thin_beam_with_a_tip_body(
    length_mm: float, magnet_density: float | None, tip_mass_kg: float
) -> None:
    specimen = thin(length_mm, magnet_density)
    vibration = Vibration(BeamModel(specimen, 26, 1), tip_mass_kg)
    motion, _ = vibration.about(LAWS["neo-hookean"], np.array([[MU_PA]]), NO_LOAD)
    expected = euler_bernoulli_Hz(specimen, tip_mass_kg)
    assert motion.frequencies_Hz()[0, 0] == pytest.approx(expected[0], rel=1e-3)
    assert motion.frequencies_Hz()[0, 1] == pytest.approx(expected[1], rel=3e-3)


@pytest.mark.parametrize("gravity", [9.80665, -0.7])
def test_gravity_along_the_beam_changes_the_frequency_as_tension_does(gravity: float) -> None:
    modulus_Pa, length = 10 * MU_PA, 0.080  # so stiff that the beam stretches by less than 0.1 %
    line, stiffness = 1000.0 * 1e-3 * 5e-3, 3 * modulus_Pa * 5e-3 * 1e-9 / 12
    pull, inertia = line * gravity * length**3 / stiffness, line * length**4 / stiffness

    def slopes(
        x: Array, y: Array, p: Array
    ) -> Array:  # deflection w, its slope and curvature, and shear force over stiffness
        return np.array([y[1], y[2], y[3] + pull * (1 - x) * y[1], inertia * p[0] ** 2 * y[0]])

    def ends(a: Array, b: Array, p: Array) -> Array:
        return np.array([a[0], a[1], b[2], b[3], b[0] - 1.0])

    x = np.linspace(0, 1, 60)
    start = np.array([x**2, 2 * x, 2 - 2 * x, 0 * x])
    guess = np.sqrt(3.516**2 / inertia + 1.57 * gravity / length)
    solved = solve_bvp(slopes, ends, x, start, p=[guess], tol=1e-8, max_nodes=20000)
    assert solved.success
    loads = Loads(np.zeros((1, 2)), np.array([[gravity, 0.0]]), np.zeros((1, 2)))
    motion, _ = Vibration(BeamModel(thin(80.0, None), 26, 1)).about(
        LAWS["neo-hookean"], np.array([[modulus_Pa]]), loads
    )
    assert motion.frequencies_Hz()[0, 0] == pytest.approx(solved.p[0] / (2 * np.pi), rel=1e-3)


@pytest.mark.parametrize(
    ("loads", "expected_Hz"),
    [
        (Loads.along([7.0]), 7.10),
        pytest.param(Loads.along([0.0]), 5.48, marks=pytest.mark.slow),
        pytest.param(NO_LOAD, 4.31, marks=pytest.mark.slow),
    ],
)
def test_the_first_specimen_of_the_paper_vibrates_at_its_known_frequencies(loads: Loads, expected_Hz: float) -> None:
    motion, _ = Vibration(SolidModel(TYPE_1, 20, 2)).about(LAWS["neo-hookean"], np.array([[46.4e3]]), loads)
    assert motion.frequencies_Hz()[0, 0] == pytest.approx(expected_Hz, rel=5e-3)


def test_parameters_give_the_same_frequencies_alone_and_among_others() -> None:
    vibration, mu = Vibration(BeamModel(TYPE_1)), np.array([[30e3], [46e3], [90e3]])
    together, _ = vibration.about(LAWS["neo-hookean"], mu, Loads.along([3.0]))
    for k in range(3):
        alone, _ = vibration.about(LAWS["neo-hookean"], mu[k : k + 1], Loads.along([3.0]))
        assert together.frequencies_Hz()[k] == pytest.approx(alone.frequencies_Hz()[0], rel=1e-8)


def test_the_motion_reduced_to_the_modes_of_another_candidate_has_nearly_the_same_frequency() -> None:
    vibration, mu = Vibration(BeamModel(TYPE_1)), np.array([[40e3], [46e3]])
    own, _ = vibration.about(LAWS["neo-hookean"], mu, Loads.along([0.0]))
    basis = (own.nodal[:, 0], own.rigid[:, 0])
    reduced, _ = vibration.about(LAWS["neo-hookean"], mu, Loads.along([0.0]), basis=basis)
    assert reduced.frequencies_Hz()[:, 0] == pytest.approx(own.frequencies_Hz()[:, 0], rel=1e-5)


def test_kelvin_voigt_and_standard_linear_solid_have_their_exact_roots() -> None:
    stiffness, rest, mass = np.array([[[120.0]]]), np.array([[[30.0]]]), np.array([[[0.01]]])
    viscosity = 0.004
    (root,) = complex_roots(stiffness, rest, mass, lambda s: 1 + viscosity * s)[0]
    exact = np.roots([0.01, 120.0 * viscosity, 150.0])
    assert root == pytest.approx(exact[np.argmax(exact.imag)], rel=1e-6)
    series = Prony(np.array([0.3]), np.array([0.02]))
    (root,) = complex_roots(stiffness, rest, mass, series.complex_ratio)[0]
    # (1 - g + g s tau / (1 + s tau)) k + rest + m s² = 0, multiplied by (1 + s tau)
    exact = np.roots([0.01 * 0.02, 0.01, 0.02 * 150.0, 0.7 * 120.0 + 30.0])
    assert root == pytest.approx(exact[np.argmax(exact.imag)], rel=1e-6)


def test_roots_of_coupled_modes_are_those_of_the_whole_matrices() -> None:
    own, _ = Vibration(BeamModel(TYPE_1)).about(LAWS["neo-hookean"], np.array([[40e3]]), Loads.along([0.0]))
    series = Prony(np.array([0.2, 0.1]), np.array([0.02, 0.5]))
    (roots,) = own.roots(lambda s: 1.2 * series.complex_ratio(s))
    for root in roots:
        whole = 1.2 * series.complex_ratio(root) * own.material + own.rest + root**2 * own.mass
        size = np.linalg.svd(whole[0] / np.abs(whole[0]).max(), compute_uv=False)
        moved = whole + 0.01 * root**2 * own.mass
        assert size[-1] < 1e-3 * np.linalg.svd(moved[0] / np.abs(moved[0]).max(), compute_uv=False)[-1]
