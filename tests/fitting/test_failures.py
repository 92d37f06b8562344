"""If a beam has no equilibrium, its solution ends with a status instead of NaN, and other beams are not affected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.beam.band import factorise
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Solid, SolidLoads, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import grid_mesh
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, PressureFace, Specimen
from eimi_fitting.beam.system import System
from eimi_fitting.laws import LAWS
from eimi_fitting.units import moduli_in_MPa

NEO = LAWS["neo-hookean"]
SOUND = {
    "neo-hookean": [46e3],
    "mooney-rivlin": [20e3, 3e3],
    "yeoh": [23e3, 1e3, 100.0],
    "ogden": [2e4, 1.7, 100.0, 8.0, -5e3, -2.5],
}
MOST_TANGENTS = 25 * (1 + 4 + 16)  # the iterations in one state: those of all load steps after two divisions
END = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
SPECIMENS = {
    "magnet at the end": Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", END),
    "magnet with silicone around it": Specimen(
        31.0, 3.0, 5.0, 1070.0, "plane-strain", replace(END, width_mm=2.0, tip_offset_mm=1.0)
    ),
    "plane stress, magnetised": Specimen(
        30.0, 3.0, 5.0, 1070.0, "plane-stress", magnetisation_A_per_m=(5e4, 0.0), pressure_face=PressureFace("left")
    ),
}
FIELD = np.linspace(0, 7.05, 4)


def check_is_a_result(shapes):
    assert set(np.unique(shapes.status)) <= {int(s) for s in Status}
    for values in (shapes.displacement, shapes.rigid, shapes.max_stretch):
        assert np.isfinite(values).all()
    assert shapes.iterations.max() <= MOST_TANGENTS
    # A failed state is not computed again.
    failed = np.logical_or.accumulate((shapes.status != Status.CONVERGED) & (shapes.status != Status.UNSTABLE), axis=1)
    assert np.all(shapes.iterations[:, 1:][failed[:, :-1]] == 0)


@pytest.mark.parametrize("specimen", SPECIMENS)
@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("factor", [1.0, -10.0])
def test_parameters_without_an_equilibrium_get_a_status_alone_and_among_others(specimen, name, factor):
    model, law = BeamModel(SPECIMENS[specimen], 6), LAWS[name]
    loads = Loads.along(factor * FIELD, pressure_Pa=2.0 * factor if model.solid.face else 0.0)
    sound = np.array(SOUND[name])
    moduli = np.array([unit == "Pa" for unit in law.units])
    scales = np.array([1.0, 1.0 / 46e3, 1e10 / 46e3, np.nan, np.inf, -1.0, 0.0, 1e300, 1e-300])
    with np.errstate(all="ignore"):
        crowd = np.where(moduli, sound * scales[:, None], sound)
    together = model.solve(law, crowd, loads)
    check_is_a_result(together)
    assert together.converged[2]  # a beam of 10 GPa hardly moves
    assert not together.converged[3:7].any()
    for k in range(len(crowd)):
        alone = model.solve(law, crowd[k : k + 1], loads)
        check_is_a_result(alone)
        if k in (0, 2, 3, 4, 5, 6):
            assert alone.status[0].tolist() == together.status[k].tolist()
        if alone.converged[0] and together.converged[k]:
            assert together.displacement[k] == pytest.approx(alone.displacement[0], abs=2e-5)


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_a_nan_in_any_parameter_is_a_status(specimen):
    model = BeamModel(SPECIMENS[specimen], 6)
    for name in SOUND:
        crowd = np.tile(SOUND[name], (len(SOUND[name]) + 1, 1)).astype(float)
        np.fill_diagonal(crowd, np.nan)
        shapes = model.solve(LAWS[name], crowd, Loads.along(FIELD))
        check_is_a_result(shapes)
        assert shapes.converged.tolist() == [False] * len(SOUND[name]) + [True]
        assert shapes.iterations[:-1].sum() == 0


@pytest.mark.parametrize("specimen", SPECIMENS)
@pytest.mark.parametrize("what", ["field_T", "gravity", "tip_force_N", "pressure_Pa"])
def test_loads_that_are_nan_or_far_too_large_give_a_status(specimen, what):
    model = BeamModel(SPECIMENS[specimen], 6)
    if what == "pressure_Pa" and model.solid.face is None:
        with pytest.raises(ValueError, match="has no pressure_face"):
            model.solve(NEO, np.array([[46e3]]), Loads.along(FIELD, pressure_Pa=FIELD))
        return
    for value in (np.nan, 1e300):
        loads = Loads.along(FIELD, pressure_Pa=0.0 * FIELD)
        changed = np.array(getattr(loads, what))
        changed[2] = value
        loads = replace(loads, **{what: changed})
        shapes = model.solve(NEO, np.array([[46e3], [5e3]]), loads)
        check_is_a_result(shapes)
        assert np.all(shapes.status[:, :2] == Status.CONVERGED)
        assert not np.any(shapes.status[:, 2:] == Status.CONVERGED)


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_a_candidate_in_a_field_far_too_large_affects_no_other(specimen):
    model, loads = BeamModel(SPECIMENS[specimen], 6), Loads.along(FIELD)
    crowd = np.array([[4.6], [46e3], [4.6]])
    shapes = model.solve(NEO, crowd, loads, field_factor=np.array([1.7e308, 1.0, -1.7e308]))
    check_is_a_result(shapes)
    assert shapes.converged.tolist() == [False, True, False]
    assert shapes.displacement[1] == pytest.approx(model.solve(NEO, [[46e3]], loads).displacement[0], abs=1e-7)


def test_the_statistics_count_the_load_steps_that_were_divided():
    model = BeamModel(SPECIMENS["magnet at the end"], 6)
    shapes = model.solve(NEO, np.array([[46e3], [5e3], [1.0]]), Loads.along(7.05))
    check_is_a_result(shapes)
    assert shapes.status[:, 0].tolist() == [Status.CONVERGED, Status.CONVERGED, Status.DIVERGED]
    assert shapes.iterations[0, 0] <= 25 < shapes.iterations[1, 0]
    stepped = model.solve(NEO, np.array([[5e3]]), Loads.along(np.linspace(0, 7.05, 12)))
    assert shapes.displacement[1, 0] == pytest.approx(stepped.displacement[0, -1], abs=1e-4)


@pytest.mark.parametrize("name", SOUND)
def test_a_block_that_is_turned_inside_out_is_not_an_equilibrium(name):
    # In plane stress its energy equals that of the block at rest, so that no force restores it.
    mesh = grid_mesh(np.linspace(0, 4, 3), np.linspace(-1, 1, 3))
    fixed = np.abs(mesh.nodes) < 1e-9  # the axes of symmetry are fixed
    solid = Solid(mesh, fixed)
    batch = Batch(LAWS[name], moduli_in_MPa(np.array([SOUND[name]]), LAWS[name].units), "plane-stress", np.ones(1))
    nothing = SolidLoads(
        np.zeros((1, len(mesh.nodes), 2)), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1), np.zeros(1)
    )
    rest = solid.rest(1)
    inside_out = replace(rest, displacement=mesh.nodes[None] * [0.0, -2.0])
    for start, expected in ((rest, Status.CONVERGED), (inside_out, Status.DIVERGED)):
        shape, status, _ = solid.equilibrium(batch, nothing, start, 1e-6)
        assert status[0] == expected
        assert np.isfinite(shape.displacement).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("spoilt", [0, 1, 2])
def test_a_right_hand_side_of_nan_affects_no_other_candidate(bad, spoilt):
    system = System(np.arange(5)[None], 5, None)
    stiffness = np.tile(2 * np.eye(5) + 0.1, (1, 3, 1, 1))
    force, right = np.zeros((1, 3, 5)), np.ones((3, 5))
    right[spoilt, 3] = bad
    steps, _, sound, _ = system.solve(stiffness, force, right, None, np.ones(3, bool), True)
    others = np.arange(3) != spoilt
    assert sound.tolist() == others.tolist()
    assert steps[others] == pytest.approx(np.full((2, 5), 0.4), rel=1e-12)
    assert np.all(steps[spoilt] == 0)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), bad=st.sampled_from([np.nan, np.inf, 1e200, 0.0, -1.0]))
def test_a_matrix_that_cannot_be_factorised_affects_no_other(seed, bad):
    rng = np.random.default_rng(seed)
    batch, n, width = 4, 12, 4
    band = 0.1 * rng.normal(size=(batch, n, width))
    band[:, :, 0] = 2.0
    for k in range(1, width):
        band[:, n - k :, k] = 0.0
    right = rng.normal(size=(batch, n))
    expected = factorise(band, np.ones(batch, bool)).solve(right)
    spoilt = rng.integers(batch)
    if bad == 0.0:
        band[spoilt] = 0.0
    else:
        band[spoilt, rng.integers(n), 0] = bad
    factor = factorise(band, np.ones(batch, bool))
    others = np.arange(batch) != spoilt
    assert factor.sound[others].all()
    assert factor.solve(right)[others] == pytest.approx(expected[others], abs=1e-12)
    assert np.isfinite(factor.solve(right)).all()
    if not np.isfinite(bad) or bad in (0.0, 1e200):
        assert not factor.sound[spoilt]
