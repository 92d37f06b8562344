"""A straight beam above its critical load is reported as buckled (unstable)."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import identify
from eimi_fitting.beam.band import factorise
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Magnet, Specimen
from eimi_fitting.beam.system import System
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Experiment, compare
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.laws import LAWS

NEO = LAWS["neo-hookean"]
MU_PA = 50e3
SHARES = np.array([0.5, 0.98, 1.02, 1.5])  # shares of the critical load
STATUSES = [Status.CONVERGED, Status.CONVERGED, Status.BUCKLED, Status.BUCKLED]
MAGNETS = {
    "at the end": Magnet(4.0, 1.0, 2.0, 1.0, 7500.0),
    "with silicone around it": Magnet(4.0, 0.5, 2.0, 1.0, 7500.0, 2.0),
}


def bending_N_mm2(specimen: Specimen) -> float:
    # Return the bending stiffness (N mm²) of a neo-Hookean beam: 3 mu I in plane stress, 4 mu I in plane strain.
    stiffness = 4 if specimen.section == "plane-strain" else 3
    return stiffness * 1e-6 * MU_PA * specimen.depth_mm * specimen.width_mm**3 / 12


@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
@pytest.mark.parametrize("magnet", MAGNETS)
@pytest.mark.parametrize("steps", [1, 3])
def test_a_beam_buckles_in_the_critical_field_against_its_magnet(section, magnet, steps):
    # The couple m B sin(theta) at the end of a rod of length l bends it by theta = m B theta l / EI.
    block = MAGNETS[magnet]
    specimen = Specimen(104.0 + block.tip_offset_mm, 1.0, 2.0, 1070.0, section, block)
    critical_mT = bending_N_mm2(specimen) / (block.moment_A_m2 * specimen.flexible_length_mm)
    field = critical_mT * np.linspace(0, 1, steps + 1)[1:]
    shapes = BeamModel(specimen).solve(
        NEO, np.full((4, 1), MU_PA), Loads.along(field, 180.0, gravity_angle_deg=None), field_factor=SHARES
    )
    # Up to 1.5 times the critical field, the second of three steps ends at this field, where the tangent is singular.
    assert shapes.status[: 4 if steps == 1 else 3, -1].tolist() == STATUSES[: 4 if steps == 1 else 3]
    assert not shapes.converged[2:].any()
    # The status is known after two step sizes.
    assert shapes.iterations.max() < 25


def test_a_solid_buckles_in_the_critical_field_against_its_magnet():
    magnet = Magnet(4.0, 2.0, 2.0, 1.0, 7500.0)
    specimen = Specimen(64.0, 2.0, 2.0, 1070.0, "solid", magnet)
    critical_mT = bending_N_mm2(specimen) / (magnet.moment_A_m2 * specimen.flexible_length_mm)
    model = SolidModel(specimen, 8, 1)
    statuses = [
        model.solve(NEO, [[MU_PA]], Loads.along(share * critical_mT, 180.0, gravity_angle_deg=None)).status[0, 0]
        for share in (0.97, 1.06)  # clamp and magnet prevent a change of the section
    ]
    assert statuses == [Status.CONVERGED, Status.BUCKLED]


@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
def test_an_upright_beam_buckles_under_its_own_weight(section):
    # Greenhill 1881, Proc. Camb. Phil. Soc. 4:65: a weight q for each mm of length, q L^3 = 7.837 EI.
    specimen = Specimen(60.0, 1.0, 2.0, 1070.0, section)
    weight = 1e-9 * specimen.density_kg_m3 * STANDARD_GRAVITY * specimen.width_mm * specimen.depth_mm
    critical_Pa = MU_PA * weight * 60.0**3 / (7.837 * bending_N_mm2(specimen))
    upright = Loads.along(0.0, gravity_angle_deg=180.0)
    shapes = BeamModel(specimen).solve(NEO, critical_Pa / SHARES[:, None], upright)
    assert shapes.status[:, 0].tolist() == STATUSES


def test_an_upright_beam_buckles_under_the_euler_load():
    # Euler: P = pi^2 EI / (4 L^2).
    specimen = Specimen(60.0, 1.0, 2.0, 0.0, "plane-stress")
    critical_N = np.pi**2 * bending_N_mm2(specimen) / (4 * 60.0**2)
    model = BeamModel(specimen)
    statuses = [
        model.solve(NEO, [[MU_PA]], Loads.along(0.0, tip_force_N=share * critical_N, tip_force_angle_deg=180.0)).status
        for share in SHARES
    ]
    assert np.ravel(statuses).tolist() == STATUSES


def test_buckling_is_detected_when_all_states_are_solved_at_once():
    magnet = MAGNETS["at the end"]
    specimen = Specimen(104.0, 1.0, 2.0, 0.0, "plane-stress", magnet)
    critical_mT = bending_N_mm2(specimen) / (magnet.moment_A_m2 * 100.0)
    loads = Loads.along(critical_mT * np.array([0.5, 0.9]), 180.0, gravity_angle_deg=None)
    model = BeamModel(specimen)
    below = model.solve(NEO, [[MU_PA]], loads, keep=True)
    assert below.converged[0]
    for stiffness, status in ((0.95, Status.CONVERGED), (0.85, Status.BUCKLED)):
        near = model.solve(NEO, [[stiffness * MU_PA]], loads, near=below.every)
        assert near.status[0].tolist() == [Status.CONVERGED, status]


def upright() -> Experiment:
    # Return a simulated experiment with an upright beam of 46 kPa in two load steps.
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
    model, loads = BeamModel(specimen, 8), Loads.along([0.0, 6.0], gravity_angle_deg=180.0)
    left, right = points_on(edge_curves(model, model.solve(NEO, [[46e3]], loads))[0], 1)[:, :, 1:-1].swapaxes(0, 1)
    sigma = np.full(left.shape[1], 3e-3)
    edges = [(a, sigma, b, sigma) for a, b in zip(left, right, strict=True)]
    return Experiment(model, loads, EdgeObservation.from_edges(edges))


def test_a_candidate_that_buckles_is_not_valid():
    every = compare(NEO, np.array([[46e3], [10e3], [40e3]]), [upright()])
    assert every.shapes[0].status[:, 0].tolist() == [Status.CONVERGED, Status.BUCKLED, Status.CONVERGED]
    assert every.unconverged.tolist() == [False, True, False]
    assert not every.unstable.any()
    assert every.objective_mm[1] == DISCARDED_MM > every.objective_mm[2] > every.objective_mm[0]
    assert np.isfinite(every.error_mm).all()


@pytest.mark.slow
def test_the_search_continues_beyond_moduli_for_which_the_beam_buckles():
    fit = identify("neo-hookean", [upright()], seed=1)
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.02)  # the edges were computed on a coarse mesh


@pytest.mark.parametrize("tied", [None, np.array([4]), np.array([0, 4])])
def test_the_check_of_definiteness_includes_the_rigid_body(tied):
    # Chains of five springs, some with negative stiffness, with or without a rigid body (three unknowns) at the ends.
    rng = np.random.default_rng(0)
    batch, d = 200, 4
    dofs = np.arange(5)[:, None] * 2 + np.arange(d)
    n = int(dofs.max()) + 1
    system = System(dofs, n, tied)
    random = rng.normal(size=(5, batch, d, d))
    stiffness = random @ random.swapaxes(-1, -2) - rng.uniform(0, 0.25, (batch, 1, 1)) * np.eye(d)
    whole = np.zeros((batch, n + 3, n + 3))
    body = None
    for e in range(5):
        whole[np.ix_(range(batch), dofs[e], dofs[e])] += stiffness[e]
    if tied is None:
        whole[:, n:, n:] = np.eye(3)
    else:
        tie, turning = rng.normal(size=(len(tied), batch, d, 3)), rng.normal(size=batch)
        further = np.zeros((batch, 3, 3))
        further[:, -1, -1] = turning
        body = tie, further, np.zeros((batch, 3))
        for e, own_tie in zip(tied, tie, strict=True):
            rows = own_tie.swapaxes(-1, -2) @ stiffness[e]
            whole[np.ix_(range(batch), range(n, n + 3), dofs[e])] += rows
            whole[np.ix_(range(batch), dofs[e], range(n, n + 3))] += rows.swapaxes(-1, -2)
            whole[:, n:, n:] += rows @ own_tie
        whole[:, -1, -1] += turning
    solution = system.solve(stiffness, np.zeros((5, batch, d)), np.ones((1, n)), body, np.ones(batch, bool), True)
    smallest = np.linalg.eigvalsh(whole)[:, 0]
    assert solution.sound.all()
    assert (solution.indefinite == (smallest < 0)).all()
    assert 20 < solution.indefinite.sum() < 180
    # The other matrices have the same solutions as when they are solved separately.
    right = np.concatenate([np.ones(n), np.zeros(3)])
    solved = np.concatenate([solution.nodes, solution.body], axis=1)
    residual = np.einsum("bij,bj->bi", whole, solved) - right
    assert np.abs(residual).max() < 1e-6 * np.abs(solved).max()


def test_the_definiteness_of_an_unsymmetric_matrix_is_not_determined():
    band = np.tile([-1.0, 0.5], (3, 4, 1))
    band[:, -1, 1] = 0.0
    assert factorise(band, np.ones(3, bool)).indefinite.all()
    assert not factorise(band, np.ones(3, bool), 0.5 * band).indefinite.any()


def test_on_request_only_definite_matrices_are_solved():
    band = np.tile([2.0, 0.5], (3, 4, 1))
    band[:, -1, 1] = 0.0
    band[1, 2, 0] = -1.0
    every, right = factorise(band, np.ones(3, bool)), np.ones((3, 4))
    definite = factorise(band, np.ones(3, bool), only_definite=True)
    assert every.sound.all()
    assert definite.sound.tolist() == [True, False, True]
    assert (definite.indefinite == every.indefinite).all()
    assert definite.solve(right)[[0, 2]] == pytest.approx(every.solve(right)[[0, 2]])
    assert (definite.solve(right)[1] == 0).all()
    assert np.abs(every.solve(right)[1]).min() > 0
