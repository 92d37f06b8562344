"""Refusals, defaults, selections and other steps of the beam models that most computations do not reach."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Beam, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam import beside as beside_module
from eimi_fitting.beam import brick, element
from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.bricks import brick_mesh
from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.inertia import Inertia
from eimi_fitting.beam.kinds_of_load import CoilField, Gravity, Pressure, TipForce, UniformField
from eimi_fitting.beam.mesh import grid_mesh
from eimi_fitting.beam.rest_shape import RestShape
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import PressureFace
from eimi_fitting.beam.strip import Strip
from eimi_fitting.beam.transient import NotSolved, Transient
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import NotInSolver
from eimi_fitting.laws.prony import Prony
from eimi_fitting.laws.yeoh import _STABILITY, _stability_polynomial
from examples.arruda_boyce import ArrudaBoyce

MAGNET = Magnet(4.0, 3.0, 2.5, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
BARE = replace(BEAM, magnet=None)
MODULUS = np.array([[80e3]])
NEO = LAWS["neo-hookean"]


@pytest.mark.parametrize(("along", "half"), [(26, 13), (5, 2), (1, 1)])
def test_a_beam_has_three_times_as_many_elements_across_as_a_model_of_half_the_length(along: int, half: int) -> None:
    beam = Beam(BARE) if along == 26 else Beam(BARE, along)
    assert isinstance(beam.model, BeamModel)
    assert (beam.model.along, beam.model.across) == (along, 3 * BeamModel(BARE, half).across)


def test_a_beam_takes_its_number_of_elements_across() -> None:
    flat, solid = Beam(BEAM, 3, 2).model, Beam(replace(BEAM, section="solid"), 2, 1).model
    assert (flat.along, flat.across) == (3, 2)
    assert isinstance(solid, SolidModel)
    assert (solid.along, solid.across) == (2, 1)
    assert Beam(replace(BARE, section="solid"), 2).model.across == 3


def test_a_planar_model_has_the_mesh_of_a_solid_one_if_only_its_section_differs() -> None:
    beside = SolidBeside(replace(BEAM, section="solid"), 3, 1)
    assert beside.has_mesh_of(BeamModel(BEAM, 3, 1))
    assert beside.has_mesh_of(BeamModel(replace(BEAM, section="plane-strain"), 3, 1, "plane-stress"))
    assert not beside.has_mesh_of(BeamModel(BEAM, 4, 1))
    assert not beside.has_mesh_of(BeamModel(BEAM, 3, 2))
    assert not beside.has_mesh_of(BeamModel(BEAM, 3, 1, "plane-strain"))
    assert not beside.has_mesh_of(BeamModel(replace(BEAM, width_mm=3.1), 3, 1))
    other = SolidBeside(replace(BEAM, section="solid"), 3, 1, 1).of(replace(BARE, section="solid"))
    assert other.specimen == replace(BARE, section="solid")
    assert (other.planar.along, other.planar.across, other.solid.more) == (3, 1, 1)


LOADS = Loads.along([1.0, 3.0, 5.0, 7.0])


@pytest.fixture(scope="module")
def beside() -> SolidBeside:
    return SolidBeside(replace(BARE, magnetisation_A_per_m=(15e3, 2e3), section="solid"), 2, 1)


def test_a_solid_is_solved_for_one_candidate(beside: SolidBeside) -> None:
    with pytest.raises(ValueError, match="one candidate at a time, but 2 are given"):
        beside.solve(NEO, np.array([[30e3], [40e3]]), LOADS)


def test_a_solid_that_cannot_be_interpolated_has_no_solution_or_is_followed(beside: SolidBeside) -> None:
    bent = replace(LOADS, gravity=np.array([[9.8, 0.0], [9.8, 1.0], [9.8, 0.0], [9.8, 2.0]]))
    flat = beside.planar.solve(NEO, MODULUS, bent, tolerance_mm=1e-2)
    shapes = beside.solve(NEO, MODULUS, bent, options=SolidOptions(method="interpolate"))
    assert (shapes.status == Status.DIVERGED).all()
    assert shapes.iterations.tolist() == flat.iterations.tolist()
    assert shapes.displacement.shape == (1, 4, *beside.mesh.nodes.shape)
    assert not shapes.displacement.any()
    assert not shapes.rigid.any()
    assert shapes.max_stretch.tolist() == [[1.0] * 4]
    assert shapes.last.displacement.shape == (1, *beside.mesh.nodes.shape)
    assert shapes.effect is None
    followed = beside.solve(NEO, MODULUS, bent)
    assert (followed.status == Status.CONVERGED).all()
    assert followed.effect is None


def solved_states(beside: SolidBeside, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    # Return a list that grows by one number for each state in which the solid is solved.
    states: list[int] = []
    found = SolidBeside._difference

    def counted(self: SolidBeside, *arguments: Any) -> Any:
        states.append(1)
        return found(self, *arguments)

    monkeypatch.setattr(SolidBeside, "_difference", counted)
    return states


def test_a_depth_effect_is_used_again_where_it_is_valid(beside: SolidBeside, monkeypatch: pytest.MonkeyPatch) -> None:
    states = solved_states(beside, monkeypatch)
    first = beside.solve(NEO, MODULUS, LOADS)
    assert first.effect is not None
    solved = len(states)
    assert solved == len(first.effect.places) >= 2
    again = beside.solve(NEO, MODULUS, LOADS, options=SolidOptions(similar=(first.effect,)))
    assert again.effect is first.effect
    assert len(states) == solved
    given = beside.solve(NEO, MODULUS, LOADS, options=SolidOptions(effect=first.effect))
    assert given.effect is first.effect
    assert len(states) == solved
    assert given.displacement == pytest.approx(first.displacement)
    earlier = beside.solve(NEO, MODULUS, LOADS, options=SolidOptions(earlier=first.effect))
    assert earlier.effect is not None
    assert earlier.effect.places == first.effect.places
    assert len(states) == solved
    wider = beside.solve(NEO, MODULUS, Loads.along([1.0, 9.0]), options=SolidOptions(earlier=first.effect))
    assert wider.effect is not None
    assert wider.effect.places[:-1] == first.effect.places
    assert len(states) == solved + 1


def test_the_accuracy_decides_in_how_many_states_a_solid_is_solved(
    beside: SolidBeside, monkeypatch: pytest.MonkeyPatch
) -> None:
    states, fields = solved_states(beside, monkeypatch), Loads.along(np.linspace(0.5, 7.0, 9))
    numbers = []
    for accuracy_mm in (0.1, beside_module.ACCURACY_MM, 1e-7):
        states.clear()
        beside.solve(NEO, MODULUS, fields, tolerance_mm=1e-3, options=SolidOptions(accuracy_mm=accuracy_mm))
        numbers.append(len(states))
    assert numbers == [4, 6, 9]


def test_the_difference_of_a_solid_is_the_prediction_within_the_accuracy(
    beside: SolidBeside, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A replacement for the solid, whose difference is known, shows after which states the solution ends.
    rest, size = beside.solid.solid.rest(1), [0.0]

    def known(self: SolidBeside, chosen: Any, loads_at: Any, load: Any, lifted: Any, predicted: Any, tol: float) -> Any:
        off = 0.0 if predicted is None else size[0]
        base = np.zeros_like(rest.displacement) if predicted is None else predicted.displacement
        return replace(rest, displacement=base + off)

    monkeypatch.setattr(SolidBeside, "_difference", known)
    for accuracy_mm, error_mm, number in [(2e-3, 1.9e-3, 3), (2e-3, 2.1e-3, 4), (1e-3, 0.9e-3, 3), (1e-3, 1.1e-3, 4)]:
        size[0] = error_mm
        options = SolidOptions() if accuracy_mm == 1e-3 else SolidOptions(accuracy_mm=accuracy_mm)
        effect = beside.solve(NEO, MODULUS, LOADS, options=options).effect
        assert effect is not None
        assert len(effect.places) == number


def effect_of_turns(beside: SolidBeside, monkeypatch: pytest.MonkeyPatch, turns: list[float]) -> Any:
    # Return the depth effect if the tip turns by given angles and all differences of solid and plane are unequal.
    rest, number = beside.solid.solid.rest(1), [0.0]

    def unequal(self: SolidBeside, *given: Any) -> Any:
        number[0] += 1.0
        return replace(rest, displacement=rest.displacement + number[0] ** 3)

    monkeypatch.setattr(SolidBeside, "_difference", unequal)
    monkeypatch.setattr(SolidBeside, "_turn", lambda self, flat: np.array(turns))
    return beside.solve(NEO, MODULUS, LOADS).effect


@pytest.mark.parametrize(
    ("turns", "by_turn"),
    [
        ([0.0, 0.0003, 0.0006, 0.00099], False),
        ([0.0, 0.0003, 0.0006, 0.00101], True),
        ([0.0, -0.5, -0.8, -1.0], True),
        ([0.0, 0.5, 1.0, 0.9991], True),
        ([0.0, 0.5, 1.0, 0.9989], False),
        ([0.0, 1.0, 2.0, 1.9981], True),
        ([0.0, 1.0, 2.0, 1.9979], False),
        ([0.0, -0.5, -1.0, -0.9991], True),
        ([0.0, -0.5, -1.0, -0.9989], False),
        ([0.5, 1.0, 0.2, 0.8], False),
    ],
)
def test_states_are_ordered_by_a_rotation_that_grows_by_more_than_a_thousandth(
    beside: SolidBeside, monkeypatch: pytest.MonkeyPatch, turns: list[float], by_turn: bool
) -> None:
    effect = effect_of_turns(beside, monkeypatch, turns)
    assert effect.by_turn is by_turn
    if not by_turn:
        assert max(effect.places) == 1.0


@pytest.mark.parametrize(
    ("turns", "places"),
    [
        ([0.1, 0.4, 0.7, 1.1], [1.1, 0.1, 0.7, 0.4]),
        ([0.1, 0.1009, 0.7, 1.1], [1.1, 0.1, 0.7]),
        ([0.1, 0.1011, 0.7, 1.1], [1.1, 0.1, 0.7, 0.1011]),
        ([0.0, 0.0002, 0.0004, 0.0011], [0.0011, 0.0, 0.0004, 0.0002]),
        ([-0.2, -0.3, -0.9, -1.2], [-1.2, -0.2, -0.9, -0.3]),
    ],
)
def test_a_state_within_a_thousandth_of_a_solved_one_is_not_solved(
    beside: SolidBeside, monkeypatch: pytest.MonkeyPatch, turns: list[float], places: list[float]
) -> None:
    assert list(effect_of_turns(beside, monkeypatch, turns).places) == places


def test_a_folded_element_is_named_by_its_number() -> None:
    flat = grid_mesh(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0]))
    turned = replace(flat, nodes=np.where(flat.nodes[:, :1] > 2, flat.nodes * [1.0, -1.0], flat.nodes))
    with pytest.raises(ValueError, match="element 2 of the mesh is folded: check the rest shape"):
        element.operators(turned)
    lines = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0])
    bricks = brick_mesh(*lines, lambda x, y, z: (x, y, np.where(x > 1, -z, z)))
    with pytest.raises(ValueError, match="element 1 of the mesh is folded: check the rest shape"):
        brick.operators(bricks)


@pytest.mark.parametrize("depths", [(), ((0.0, 0.4), (1.0, -0.4)), ((0.0, 0.4), (1.0, 0.2))])
def test_the_masses_of_the_elements_sum_up_to_the_mass_of_the_beam(depths: Any) -> None:
    specimen = replace(BARE, rest_shape=RestShape(depths=depths))
    depth = 5.0 + (np.mean([value for _, value in depths]) if depths else 0.0)
    mass_kg = 1e-9 * 1070 * 30 * 3 * depth
    flat, solid = Inertia(BeamModel(specimen, 4, 1)), Inertia(SolidModel(specimen, 2, 1))
    assert flat.of_elements.sum() == pytest.approx(
        1e-3 * mass_kg / BeamModel(specimen, 2, 1).grid.strip.straight.depth_mm
    )
    assert solid.of_elements.sum() == pytest.approx(1e-3 * mass_kg / 2)


def test_each_kind_of_load_can_be_restricted_to_some_states() -> None:
    rows, states = np.arange(8.0).reshape(4, 2), np.array([3, 1])
    shape = CoilShape((1.0, 0.0))
    for kind in (UniformField(rows), CoilField(rows, shape), Gravity(rows), TipForce(rows), Pressure(rows[:, :1])):
        chosen: Any = kind.take(states)
        assert type(chosen) is type(kind)
        assert chosen.numbers.tolist() == kind.numbers[states].tolist()
        assert getattr(chosen, "shape", None) is getattr(kind, "shape", None)


def test_a_mesh_is_flat_or_solid_with_or_without_a_face() -> None:
    flat, solid = BeamModel(replace(BARE, pressure_face=PressureFace("left")), 2, 1), SolidModel(BARE, 2, 1)
    assert (flat.loaded.is_solid, flat.loaded.has_pressure_face) == (False, True)
    assert (solid.loaded.is_solid, solid.loaded.has_pressure_face) == (True, False)


@pytest.mark.parametrize("model", [BeamModel, SolidModel])
def test_a_magnet_must_leave_a_flexible_part(model: Any) -> None:
    long = replace(BEAM, magnet=replace(MAGNET, length_mm=28.0, tip_offset_mm=2.0))
    with pytest.raises(ValueError, match="its distance from the tip take 30 mm of a beam of 30 mm: no flexible part"):
        model(long, 2, 1)
    short = replace(BEAM, magnet=replace(MAGNET, length_mm=28.0, tip_offset_mm=1.9))
    assert model(short, 2, 1).mesh.nodes[:, 0].max() == pytest.approx(30.0)


def test_impossible_loads_and_models_are_refused_with_their_reason() -> None:
    with pytest.raises(ValueError, match="the tip force has no direction: give tip_force_angle_deg, or gravity_angle"):
        Loads.along([1.0], gravity_angle_deg=None, tip_force_N=0.1)
    pressed = BeamModel(replace(BARE, pressure_face=PressureFace("left")), 2, 1)
    with pytest.raises(ValueError, match="vibrations under a pressure are not computed: leave out pressure_face"):
        Vibration(pressed)
    with pytest.raises(ValueError, match="Gravity has 1 states, but the other loads have 4: give one row"):
        LOADS.plus(Gravity(np.zeros((1, 2))))
    with pytest.raises(NotInSolver, match="the arruda-boyce law cannot be exported to sofa; choose another program"):
        InvariantLaw.card(ArrudaBoyce(), "sofa", {}, 1.0)
    model, series = BeamModel(BEAM, 2, 1), Prony(np.array([0.1]), np.array([1.0]))
    with pytest.raises(NotSolved, match="no equilibrium of the beam was found under the loads at the start"):
        Transient(model, NEO, np.array([-1.0]), series, Loads.along([1.0]))


@pytest.mark.parametrize("end_rad", [2.5, -3.0])
def test_points_of_a_strongly_bent_beam_are_found_again(end_rad: float) -> None:
    turns = tuple((share, end_rad * share) for share in np.linspace(0, 1, 6))
    strip = Strip(replace(BARE, rest_shape=RestShape(turns=turns, widths=((0.0, 0.2), (1.0, -0.3)))))
    points = np.array([[0.0, 0.5], [3.0, -1.4], [11.0, 1.2], [19.0, 0.0], [27.0, -0.7], [30.0, 1.1]])
    assert strip.straightened(strip.at_rest(points)) == pytest.approx(points, abs=1e-7)


def test_the_surface_of_a_magnet_as_deep_as_the_beam_is_on_the_magnet() -> None:
    deep, shallow = (SolidModel(replace(BEAM, magnet=replace(MAGNET, depth_mm=size)), 2, 1).grid for size in (5.0, 4.0))
    points = np.array([[27.0, 0.3, 2.5005], [27.0, 0.3, -2.5005]])
    assert deep.on_magnet(points).tolist() == [True, True]
    assert shallow.on_magnet(points).tolist() == [False, False]


def test_a_shape_without_turns_has_no_angle_anywhere() -> None:
    assert RestShape().angle_rad(np.array([[0.0, 0.5], [0.7, 1.0]])).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_the_stability_polynomial_of_yeoh_is_that_of_equibiaxial_tension() -> None:
    assert _stability_polynomial() == pytest.approx(_STABILITY)
    c10, c20, c30 = 0.7, -0.2, 0.05
    for q in (1.0, 1.3, 2.5):
        i1, i2 = 2 * q + q**-2, q * q + 2 / q
        x = i1 - 3
        slope, bend = c10 + 2 * c20 * x + 3 * c30 * x * x, 2 * c20 + 6 * c30 * x
        expected = q**5 * (slope * i2 + bend * (i1 * i2 - 9))
        powers = (q - 1) ** np.arange(10)
        assert powers @ _stability_polynomial() @ [c10, c20, c30] == pytest.approx(expected)


def test_a_step_in_time_ends_with_a_small_iteration_or_after_twelve(monkeypatch: pytest.MonkeyPatch) -> None:
    model, series = BeamModel(BARE, 2, 1), Prony(np.array([0.1]), np.array([1.0]))
    motion = Transient(model, NEO, MODULUS[0], series, Loads.along([0.0]))
    sizes: list[float] = []

    def stepped(self: Transient, *given: Any) -> tuple[np.ndarray, np.ndarray]:
        moved = np.zeros(model.mesh.nodes.shape)
        moved[-1, 1] = sizes.pop(0)
        return moved, np.zeros(3)

    monkeypatch.setattr(Transient, "_newton", stepped)
    for given, left in [([0.9e-7, 1.0], 1), ([-1.1e-7, 0.9e-7, 1.0], 1), ([1e-3] * 11 + [9e-8, 1.0], 1)]:
        sizes[:] = given
        motion._advance(0.1, Loads.along([0.0]), False)
        assert len(sizes) == left
    for given, left in [([1e-3] * 14, 2), ([1e-3, np.nan, 1e-3, 1e-3], 2)]:
        sizes[:] = given
        with pytest.raises(NotSolved, match=r"does not converge at 0\.4 s"):
            motion._advance(0.1, Loads.along([0.0]), False)
        assert len(sizes) == left
    assert motion.time_s == pytest.approx(0.3)


def test_a_step_in_time_is_divided_until_it_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = Transient(
        BeamModel(BARE, 2, 1), NEO, MODULUS[0], Prony(np.array([0.1]), np.array([1.0])), Loads.along([0.0])
    )
    before, lengths = motion._state, []

    def only_short(self: Transient, step_s: float, *given: Any) -> None:
        lengths.append(step_s)
        if step_s > 0.3 and len(lengths) != 2:
            raise NotSolved
        self.time_s += step_s
        self._state = replace(self._state, nodes=self._state.nodes + 1)

    monkeypatch.setattr(Transient, "_advance", only_short)
    motion.advance(1.0, Loads.along([0.0]))
    assert lengths == [1.0, 0.5, 0.5, *[0.25] * 4]
    assert motion.time_s == 1.0
    assert motion._state.nodes == pytest.approx(before.nodes + 4)
