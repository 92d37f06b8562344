"""Each threshold of the beam models has the stated value, and their meshes have the expected elements."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.beam import path
from eimi_fitting.beam.band import BandAssembly, bandwidth, bounded, factorise
from eimi_fitting.beam.beside import _along_ray, _most_suitable
from eimi_fitting.beam.coil_field import FieldTable
from eimi_fitting.beam.depth_effect import BentCandidate, DepthEffect
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Configuration, Solid, Status, combine, joined
from eimi_fitting.beam.grid import Grid, _across_magnet, _count
from eimi_fitting.beam.mesh import graded, mapped_mesh
from eimi_fitting.beam.modal_motion import complex_roots, squares_by_stiffening
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.rest_modes import bend_offset, with_modes
from eimi_fitting.beam.rest_shape import RestShape, centre_line
from eimi_fitting.beam.solid_grid import SolidGrid, _depth_lines
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.strip import ImpossibleShape, Strip
from eimi_fitting.beam.transient import NotSolved, Transient
from eimi_fitting.laws.prony import Prony

NEO_HOOKEAN = LAWS["neo-hookean"]
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)


def test_candidates_are_in_megapascals_and_nearly_incompressible() -> None:
    found = path.candidates(NEO_HOOKEAN, np.array([[30e3], [-1.0], [np.nan]]), "plane-strain", None, None)
    assert found.batch.parameters[:, 0] == pytest.approx([0.03, -1e-6, 1e-6])
    assert found.batch.bulk[0] == pytest.approx(1e4 * 0.03)
    assert found.sound.tolist() == [True, False, False]
    batch, factor = found.take(np.array([0, 0]))
    assert (batch.bulk.tolist(), factor.tolist()) == ([300.0, 300.0], [1.0])
    given = path.candidates(
        NEO_HOOKEAN, np.array([[30e3]] * 4), "solid", np.array([2e5, 1e30, 0.0, np.inf]), [1, 2, 3, 4]
    )  # type: ignore[arg-type]
    assert given.batch.bulk[:2] == pytest.approx([0.2, 1e8 * 0.03])  # a hundred million times the shear modulus at most
    assert given.sound.tolist() == [True, True, False, False]
    assert given.take(np.array([1]))[1].tolist() == [2.0]


class Stretched:
    # A replacement for a solid whose largest stretch is given by the first displacement.

    mesh = SimpleNamespace(nodes=np.zeros((1, 1)))

    def stretch(self, displacement: np.ndarray) -> np.ndarray:
        return np.asarray(displacement.reshape(1, -1, 1))

    def rest(self, batch: int) -> Configuration:
        return state(*[0.0] * batch)


def state(*values: float) -> Configuration:
    # Return the configurations of several candidate laws; all numbers of a configuration are equal to its value.
    one = np.array(values)
    return Configuration(one[:, None, None].copy(), np.tile(one[:, None], 3), one[None, :, None].copy(),
                         one[None, None, :, None].copy())  # fmt: skip


def test_a_strain_is_as_predicted_below_three_halves_and_two_per_cent() -> None:
    solid: Any = Stretched()
    found = path._as_predicted(solid, state(1.1, 1.1, 1.0, 1.0), state(1.169, 1.171, 1.019, 1.021))
    assert found.tolist() == [True, False, True, False]


def line(*places: float, degree: int = 1) -> path.Path:

    return [(np.array([place, 2 * place]), state(place**degree)) for place in places]


def extrapolated(solved: path.Path, to: float) -> float | None:
    found = path._extrapolate(solved, np.array([to, 2 * to]))
    return None if found is None else float(found.rigid[0, 0])


def test_five_states_on_a_line_predict_the_next_one() -> None:
    eight = tuple(float(k) for k in range(8))
    assert extrapolated(line(*eight, degree=4), 8.0) == pytest.approx(8.0**4)
    nodes = np.array(eight[-5:])
    expected = np.polyval(np.polyfit(nodes, nodes**5, 4), 8.0)
    assert extrapolated(line(*eight, degree=5), 8.0) == pytest.approx(expected)
    assert extrapolated(line(1.0), 2.0) is None
    assert extrapolated(line(1.0, 2.0), 2.0) is None  # the load is the same
    assert extrapolated(line(1.0, 2.0), 5.0) == pytest.approx(5.0)
    off_the_line = [(np.array([-1.0, 3.0]), state(7.0)), *line(1.0, 2.0)]
    assert extrapolated(off_the_line, 3.0) == pytest.approx(3.0)
    assert extrapolated([*off_the_line[:1], *line(2.0)], 3.0) is None
    nearly = [(np.array([1.0, 2.0 + 1e-8]), state(1.0)), *line(2.0)]
    assert extrapolated(nearly, 3.0) is None


def test_states_that_are_too_close_to_each_other_do_not_swing_an_extrapolation() -> None:
    # The distances count in units of the distance to the new load, here 1.
    assert extrapolated(line(0.79, 1.0, degree=2), 2.0) == pytest.approx(1 + (1 - 0.79**2) / 0.21)
    assert extrapolated(line(0.0, 0.81, 1.0, degree=2), 2.0) is None  # 0.81 is too close to 1
    assert extrapolated(line(0.0, 0.79, 1.0, degree=2), 2.0) == pytest.approx(4.0)
    assert extrapolated(line(3.0, 1.0), 2.0) is None  # a state ahead is not used


class Steps:
    # Replaces a solid beam model: it records each load, and returns `outcomes` in turn (status, iterations).

    def __init__(self, *outcomes: tuple[Status, int]) -> None:
        self.outcomes, self.asked = list(outcomes), list[tuple[float, float, int | None, bool]]()

    def equilibrium(
        self, batch: Any, loads: float, start: Configuration, tolerance_mm: float, few: int | None = None,
        only_try: bool = False,
    ) -> tuple[Configuration, np.ndarray, np.ndarray]:  # fmt: skip
        status, spent = self.outcomes.pop(0) if self.outcomes else (Status.CONVERGED, 2)
        self.asked.append((loads, float(start.rigid[0, 0]), few, only_try))
        count = len(start.rigid)
        return state(*[loads] * count), np.full(count, status, np.int8), np.full(count, spent, np.intp)

    def stretch(self, displacement: np.ndarray) -> np.ndarray:
        return np.ones((1, len(displacement), 1))


def advanced(steps: Steps, tolerance_mm: float = 1e-6, near: Configuration | None = None) -> tuple[int, int, float]:
    # Go from the equilibrium at load 1 to load 2; return status, iterations and one number of the equilibrium.
    chosen: Any = SimpleNamespace(take=lambda rows: (None, None))
    now = state(1.0)
    status, spent = path._advance(
        steps, lambda load, factor: float(load[0]), chosen, np.arange(1), [(np.array([1.0]), state(1.0))],  # type: ignore[arg-type,return-value]
        np.array([2.0]), now, tolerance_mm, near,
    )  # fmt: skip
    return int(status[0]), int(spent[0]), float(now.rigid[0, 0])


def test_a_step_that_fails_is_repeated_in_four_sixteen_and_sixty_four_parts() -> None:
    steps = Steps()
    assert advanced(steps) == (Status.CONVERGED, 2, 2.0)
    assert steps.asked == [(2.0, 1.0, 6, False)]
    steps = Steps((Status.DIVERGED, 3))
    assert advanced(steps) == (Status.CONVERGED, 3 + 4 * 2, 2.0)
    assert [load for load, *_ in steps.asked] == [2.0, 1.25, 1.5, 1.75, 2.0]
    steps = Steps((Status.DIVERGED, 1), (Status.DIVERGED, 1), (Status.DIVERGED, 1))
    assert advanced(steps) == (Status.CONVERGED, 3 + 64 * 2, 2.0)
    assert [load for load, *_ in steps.asked[:4]] == [2.0, 1.25, 1 + 1 / 16, 1 + 1 / 64]
    assert [few for _, _, few, _ in steps.asked] == [6, 6, 6] + [None] * 64
    steps = Steps((Status.DIVERGED, 1), (Status.DIVERGED, 1), (Status.DIVERGED, 1), (Status.DIVERGED, 1))
    assert advanced(steps) == (Status.DIVERGED, 4, 1.0)


def test_a_loose_tolerance_allows_one_iteration_less() -> None:
    for tolerance_mm, few in ((1e-3, 6), (1.1e-3, 5)):
        steps = Steps()
        advanced(steps, tolerance_mm)
        assert steps.asked[0][2] == few


def test_many_iterations_may_end_on_another_path() -> None:
    steps = Steps((Status.CONVERGED, 6))
    assert advanced(steps)[0] == Status.CONVERGED
    assert len(steps.asked) == 1
    steps = Steps((Status.CONVERGED, 7))
    assert advanced(steps) == (Status.CONVERGED, 7 + 8, 2.0)
    steps = Steps((Status.CONVERGED, 7), (Status.CONVERGED, 7), (Status.CONVERGED, 7), *[(Status.CONVERGED, 7)] * 64)
    assert advanced(steps)[0] == Status.ASTRAY


def test_a_start_from_a_similar_beam_is_only_tried() -> None:
    steps = Steps()
    assert advanced(steps, near=state(1.9))[0] == Status.CONVERGED
    assert steps.asked == [(2.0, 1.9, 6, True)]
    steps = Steps((Status.BUCKLED, 1))
    assert advanced(steps, near=state(1.9)) == (Status.CONVERGED, 3, 2.0)
    assert [(start, only_try) for _, start, _, only_try in steps.asked] == [(1.9, True), (1.0, False)]


def test_a_beam_that_buckles_twice_on_its_path_is_not_tried_in_smaller_steps() -> None:
    steps = Steps(*[(Status.BUCKLED, 2)] * 9)
    assert advanced(steps)[0] == Status.BUCKLED
    assert [load for load, *_ in steps.asked] == [2.0, 1.25]


def test_configurations_are_combined_joined_and_replaced_by_rows() -> None:
    total = combine([2.0, -1.0], [state(1.0, 3.0), state(5.0, 1.0)])
    assert total.rigid[:, 0].tolist() == [-3.0, 5.0]
    both = joined([state(1.0), state(2.0, 3.0)])
    for part in (both.displacement[:, 0, 0], both.pressure[0, :, 0], both.stress[0, 0, :, 0], both.rigid[:, 2]):
        assert part.tolist() == [1.0, 2.0, 3.0]
    both.put(np.array([2, 0]), state(7.0, 8.0))
    for part in (both.displacement[:, 0, 0], both.pressure[0, :, 0], both.stress[0, 0, :, 0], both.rigid[:, 2]):
        assert part.tolist() == [8.0, 2.0, 7.0]
    copy = both.copy()
    both.displacement[:], both.rigid[:], both.pressure[:], both.stress[:] = 0.0, 0.0, 0.0, 0.0
    for part in (copy.displacement, copy.rigid, copy.pressure, copy.stress):
        assert part.any()


def small_solid() -> tuple[BeamModel, Batch, Any, Configuration]:
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress"), 2, 1)
    loads = Loads.along([0.0], gravity_angle_deg=90.0)
    chosen = path.candidates(NEO_HOOKEAN, np.array([[1e6]]), "plane-stress", None, None)
    return model, chosen.batch, loads.on(model.loaded)(loads.state(0), np.ones(1)), model.solid.rest(1)


def test_newtons_method_takes_at_most_twenty_five_iterations() -> None:
    model, batch, loads, start = small_solid()
    _, status, spent = model.solid.equilibrium(batch, loads, start, 0.0)
    assert (status.tolist(), spent.tolist()) == ([Status.OUT_OF_ITERATIONS], [25])
    assert model.solid.equilibrium(batch, loads, start, 0.0, 3)[2].tolist() == [3]


@pytest.mark.parametrize(("move_mm", "status"), [(299.0, Status.CONVERGED), (301.0, Status.DIVERGED)])
def test_a_step_of_ten_times_the_size_of_the_mesh_diverges(
    monkeypatch: pytest.MonkeyPatch, move_mm: float, status: Status
) -> None:
    model, batch, loads, start = small_solid()
    moves = iter([move_mm, 0.0])
    made = Solid._step

    def step(*given: Any) -> Any:
        one = made(*given)
        return replace(one, nodal=np.full_like(one.nodal, next(moves)), indefinite=np.zeros(1, bool))

    monkeypatch.setattr(Solid, "_step", step)
    assert model.solid.equilibrium(batch, loads, start, 1e-6)[1].tolist() == [status]


def test_elements_are_shorter_at_the_ends_by_their_density() -> None:
    lines = graded(20.0, 40, 2.0, 10.0, 5.0)
    sizes = np.diff(lines)
    middle = 0.5 * (lines[1:] + lines[:-1])
    density = 1 + 10 * np.exp(-middle / 2) + 5 * np.exp((middle - 20) / 2)
    assert sizes * density == pytest.approx(np.full(40, (sizes * density).mean()), rel=0.02)
    assert (lines[0], lines[-1]) == (0.0, 20.0)
    stepped = graded(20.0, 40, 2.0, 0.0, 0.0, np.array([6.0]))
    assert 6.0 in stepped.tolist()
    sizes, middle = np.diff(stepped), 0.5 * (stepped[1:] + stepped[:-1])
    density = 1 + 5 * np.exp(-np.abs(middle - 6.0) / 2)
    for part in (middle < 6.0, middle > 6.0):
        assert (sizes * density)[part] == pytest.approx(np.full(part.sum(), (sizes * density)[part].mean()), rel=0.05)


def ratio_of_sizes(lines: np.ndarray) -> float:
    sizes = np.diff(lines)
    return float(sizes.max() / sizes.min())


def test_the_mesh_of_a_beam_is_finer_at_the_clamp_and_at_the_magnet() -> None:
    grid = Grid(Specimen(104.0, 2.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 2.0, 2.0, 1.2, 7500.0)), 400, 2)
    sizes = np.diff(grid.x_mm)[:400]
    assert sizes[200] / sizes[0] == pytest.approx(11.0, rel=0.1)
    assert sizes[200] / sizes[-1] == pytest.approx(6.0, rel=0.1)
    bare = np.diff(Grid(Specimen(100.0, 2.0, 5.0, 1070.0, "plane-stress"), 400, 2).x_mm)
    assert bare[200] / bare[0] == pytest.approx(11.0, rel=0.1)
    assert bare[200] / bare[-1] == pytest.approx(1.0, rel=0.01)


def test_a_narrow_magnet_has_finer_elements_at_its_corners() -> None:
    lines, beside = _across_magnet(10.0, 6.0, 5)
    assert beside == 3  # at least half of the elements across; the layer of 2 mm alone would get 1.5
    assert lines[beside] == pytest.approx(-3.0)
    assert lines[-1 - beside] == pytest.approx(3.0)
    assert len(lines) - 1 == 3 + 3 + 3
    assert lines == pytest.approx(-lines[::-1])
    fine, beside = _across_magnet(10.0, 6.0, 100)
    assert (beside, len(fine) - 1 - 2 * beside) == (50, 60)
    wide, beside = _across_magnet(10.0, 1.0, 100)
    assert (beside, len(wide) - 1 - 2 * beside) == (68, 50)  # 1.5 times 4.5 mm over 0.1 mm, rounded to even
    sizes = np.diff(fine)
    assert sizes[0] / sizes[49] == pytest.approx((1 + 3 * np.exp(-2)) ** -1 * 4.0, rel=0.1)
    assert ratio_of_sizes(fine[50:111]) == pytest.approx((4 + 3 * np.exp(-6)) / (1 + 6 * np.exp(-3)), rel=0.05)


def test_a_part_has_elements_by_its_length_but_two_at_least_and_twice_the_number_at_most() -> None:
    assert [_count(13, share) for share in (0.01, 0.19, 0.2, 0.5, 1.9, 3.0)] == [2, 2, 3, 6, 25, 26]


@pytest.mark.parametrize(
    ("width", "offset", "block"),
    [
        (2.89, 0.07, (4.0, 2.89)),  # more than a fiftieth of the width on each side, and behind the magnet
        (2.87, 0.0, (4.0, 2.87)),
        (2.89, 0.05, (4.05, 2.89)),
        (2.93, 0.07, (4.0, 3.0)),
        (2.93, 0.05, (4.05, 3.0)),
    ],
)
def test_silicone_thinner_than_a_fiftieth_of_the_width_moves_with_the_magnet(
    width: float, offset: float, block: tuple[float, float]
) -> None:
    # A fiftieth of the width of 3 mm is 0.06 mm: 0.12 mm on both sides together.
    width = 2.87 if width == 2.89 else width
    specimen = replace(BEAM, magnet=Magnet(4.0, width, 2.0, 1.2, 7500.0, tip_offset_mm=offset))
    grid = Grid(specimen, 8, 2)
    expected = (block[0], 2.87 if block[1] == 2.89 else block[1])
    assert grid.block_mm[:2] == pytest.approx(expected)


def test_points_beyond_the_beam_by_less_than_a_micrometre_are_on_it() -> None:
    grid = Grid(BEAM, 8, 2)
    for inside, outside in (((30.0009, 0.0), (30.0011, 0.0)), ((9.0, -1.5009), (9.0, 1.5011)),
                            ((-0.0009, 0.0), (-0.0011, 0.0))):  # fmt: skip
        assert grid.place(np.array([inside]))[1].sum() == pytest.approx(1.0)
        with pytest.raises(
            ValueError, match=r"is not on the specimen, which covers x from 0 to 30 mm and y from -1\.5"
        ):
            grid.place(np.array([[15.0, 0.0], outside]))
    solid = SolidGrid(replace(BEAM, section="solid"), 4, 1)
    assert solid.place(np.array([[9.0, 0.0, -2.5009]]))[1].sum() == pytest.approx(1.0)
    with pytest.raises(
        ValueError, match=r"a point at z = 2\.5011 mm is not on the specimen, which covers z from -2\.5"
    ):
        solid.place(np.array([[9.0, 0.0, 2.5011]]))


def test_a_default_mesh_has_thirteen_elements_along_and_square_ones_across() -> None:
    assert (BeamModel(BEAM).along, BeamModel(BEAM).across) == (13, 1)
    wide = Specimen(10.0, 8.0, 5.0, 1070.0, "plane-stress")
    assert BeamModel(wide).across == 5  # half of 13 times 0.8
    assert BeamModel(replace(wide, width_mm=30.0)).across == 6
    fine, halved = BeamModel(wide, 4, 2).refined(), BeamModel(wide, 4, 2).halved()
    assert (fine.along, fine.across, halved.along, halved.across) == (8, 6, 8, 4)
    solid = SolidModel(replace(BEAM, section="solid"))
    assert len(solid.grid.flat.x_mm) - 1 == 26 + 4  # four of them over the magnet
    assert (len(solid.grid.flat.y_mm), len(solid.grid.z_mm)) == (4, 5)


def test_half_of_the_depth_has_two_elements_and_one_more_behind_a_deep_magnet() -> None:
    specimen = Specimen(30.0, 2.0, 10.0, 1070.0, "solid")
    assert _depth_lines(specimen, 0.0, 0) == pytest.approx([0.0, 2.5, 5.0])
    assert _depth_lines(specimen, 10.0, 1) == pytest.approx(np.linspace(0.0, 5.0, 4))
    for depth_mm, magnet_mm, behind, before in (
        (10.0, 5.9, 2, 2), (10.0, 6.1, 3, 2), (10.0, 3.9, 2, 3), (10.0, 4.1, 2, 2)
    ):  # fmt: skip
        lines = _depth_lines(replace(specimen, depth_mm=depth_mm), magnet_mm, 0)
        edge = int(np.argmin(np.abs(lines - 0.5 * magnet_mm)))
        assert lines[edge] == pytest.approx(0.5 * magnet_mm)
        assert (edge, len(lines) - 1 - edge) == (behind, before)
    fine = _depth_lines(Specimen(30.0, 2.0, 10.0, 1070.0, "solid"), 4.0, 200)
    sizes, edge = np.diff(fine), int(np.argmin(np.abs(fine - 2.0)))
    assert sizes[0] / sizes[edge - 1] == pytest.approx(4.0 / (1 + 3 * np.exp(-2.0)), rel=0.05)
    assert sizes[-1] / sizes[edge] == pytest.approx(4.0 / (1 + 3 * np.exp(-3.0)), rel=0.05)


def test_a_magnet_is_shallower_from_a_fiftieth_of_the_width_on() -> None:
    for depth_mm, block_mm in ((4.87, 4.87), (4.89, 5.0)):
        specimen = replace(BEAM, section="solid", magnet=Magnet(4.0, 3.0, depth_mm, 1.2, 7500.0))
        assert SolidGrid(specimen, 4, 1).block_mm[2] == pytest.approx(block_mm)


def test_a_mesh_needs_an_element_in_each_direction() -> None:
    for along, across in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match=f"but {along} x {across} are given"):
            mapped_mesh(along, across, lambda s, t: (s, t))
    assert len(mapped_mesh(1, 1, lambda s, t: (s, t)).elements) == 1


def test_the_bandwidth_is_the_largest_distance_of_two_unknowns_of_an_element() -> None:
    assert bandwidth(np.array([[0, 3, -1], [2, 4, 9]])) == 7
    assert bandwidth(np.array([[-1, 5, -1], [1, 2, 3]])) == 2


def test_elements_are_added_into_the_band_in_groups_or_together() -> None:
    rng = np.random.default_rng(0)
    dofs = np.array([[0, 1, -1], [1, 2, 0], [2, 3, 1], [3, -1, 2]])
    matrices = rng.normal(size=(4, 2, 3, 3))
    matrices = matrices + matrices.swapaxes(-1, -2)
    whole, vectors = np.zeros((2, 4, 4)), rng.normal(size=(4, 2, 3))
    total = np.zeros((2, 4))
    for element, rows in enumerate(dofs):
        for i in np.flatnonzero(rows >= 0):
            total[:, rows[i]] += vectors[element, :, i]
            for j in np.flatnonzero(rows >= 0):
                whole[:, rows[i], rows[j]] += matrices[element, :, i, j]
    for at_once in (None, 1, 3):
        assembly = BandAssembly(dofs, 4, at_once)
        assert len(assembly.parts) == (1 if at_once is None else -(-4 // at_once))
        band = assembly.matrix(assembly.divided(matrices))
        for diagonal in range(3):
            expected = np.diagonal(whole, -diagonal, axis1=1, axis2=2)
            assert band[:, : 4 - diagonal, diagonal] == pytest.approx(expected)
        assert assembly.vector(vectors) == pytest.approx(total)
        for batch in range(1, 36):  # more sizes of batches than are kept
            assert assembly.matrix(assembly.divided(np.repeat(matrices[:, :1], batch, axis=1)))[-1] == pytest.approx(
                band[0]
            )


def test_matrices_are_factorised_alone_whatever_the_others_are() -> None:
    rng = np.random.default_rng(1)
    positive = np.stack([np.full(5, 4.0), [1.0, -1.0, 0.5, 0.2, 0.0]], axis=1)
    indefinite, spoilt, zero = positive * [-1.0, 1.0], positive * np.nan, np.zeros((5, 2))
    band = np.stack([indefinite, positive, spoilt, positive * 2, indefinite * 3, zero])
    right = rng.normal(size=(2, 6, 5))
    factors = factorise(band.copy(), np.ones(6, bool))
    assert factors.sound.tolist() == [True, True, False, True, True, False]
    assert factors.indefinite.tolist() == [True, False, False, False, True, True]
    found = factors.solve(right)
    for k in (0, 1, 3, 4):
        matrix = np.diag(band[k, :, 0]) + np.diag(band[k, :-1, 1], -1) + np.diag(band[k, :-1, 1], 1)
        assert found[:, k] @ matrix == pytest.approx(right[:, k])
    assert not found[:, 2].any()
    tried = factorise(band.copy(), np.array([True, True, True, True, False, True]), only_definite=True)
    assert tried.sound.tolist() == [False, True, False, True, False, False]
    assert tried.solve(right)[:, [1, 3]] == pytest.approx(found[:, [1, 3]])
    upper = band[[1, 3]] * [1.0, 0.5]
    general = factorise(band[[1, 3]], np.ones(2, bool), upper)
    assert general.indefinite.tolist() == [False, False]
    for k, (low, high) in enumerate(zip(band[[1, 3]], upper, strict=True)):
        matrix = np.diag(low[:, 0]) + np.diag(low[:-1, 1], -1) + np.diag(high[:-1, 1], 1)
        assert matrix @ general.solve(right[0, [1, 3]])[k] == pytest.approx(right[0, [1, 3][k]])
    assert bounded(np.array([[[1.0]], [[np.inf]], [[1e200]], [[1e100]]])).tolist() == [True, False, False, True]


def bent(bulk_ratio: float = 1e4, shift_mm: float = 0.0) -> BentCandidate:
    return BentCandidate(NEO_HOOKEAN, bulk_ratio, np.full((2, 3), shift_mm))


def test_a_depth_effect_belongs_to_the_same_law_bulk_ratio_and_planar_shapes() -> None:
    assert bent().is_alike(bent(1.0009e4, 0.9e-3), 1e-3)
    assert not bent().is_alike(bent(1.0012e4), 1e-3)
    assert not bent().is_alike(bent(shift_mm=1.1e-3), 1e-3)
    assert not bent().is_alike(replace(bent(), law=LAWS["yeoh"]), 1e-3)
    assert not bent().is_alike(replace(bent(), planar=np.zeros((1, 3))), 1e-3)


def effect_at(*places: float, by_turn: bool = True) -> DepthEffect:
    return DepthEffect(places, tuple(state(place**2) for place in places), by_turn)


def test_a_depth_effect_is_a_polynomial_that_reaches_a_tenth_beyond_its_states() -> None:
    effect = effect_at(0.0, 1.0, 2.0)
    assert effect.at(1.5).rigid[0, 0] == pytest.approx(2.25)
    displacement, rigid = effect.displacements(np.array([0.5, 3.0]))
    assert displacement[:, 0, 0] == pytest.approx([0.25, 9.0])
    assert rigid[:, 1] == pytest.approx([0.25, 9.0])
    assert effect.reaches(np.array([-0.21, -0.19, 2.19, 2.21])).tolist() == [False, True, True, False]
    assert effect.covers(np.array([0.0, 2.1]))
    assert not effect.covers(np.array([0.0, 2.3]))
    more = effect.with_one(3.0, state(27.0))
    assert more.places == (0.0, 1.0, 2.0, 3.0)
    assert more.at(3.0).rigid[0, 0] == pytest.approx(27.0)
    thin = effect_at(0.0, 0.1, 1.0, 2.0, 1.9).thinned(3)
    assert thin.places == (2.0, 0.0, 1.0)
    assert thin.at(1.5).rigid[0, 0] == pytest.approx(2.25)
    assert len(effect.thinned(7).places) == 3


def test_a_depth_effect_corrects_that_of_a_similar_candidate() -> None:
    base = effect_at(0.0, 1.0, 2.0)
    corrected = DepthEffect((1.5,), (state(1.5**2 + 3.0),), True, base)
    # The correction is zero at rest and grows in proportion to the rotation.
    assert corrected.at(0.75).rigid[0, 0] == pytest.approx(0.75**2 + 1.5)
    assert corrected.displacements(np.array([0.75]))[0][0, 0, 0] == pytest.approx(0.75**2 + 1.5)
    assert corrected.places_of_base == (0.0,)
    assert corrected.reaches(np.array([-0.14, 1.64, 1.66])).tolist() == [True, True, False]
    assert replace(corrected, by_turn=False).places_of_base == ()
    assert replace(corrected, by_turn=False).at(0.5).rigid[0, 0] == pytest.approx(0.25 + 3.0)
    empty = DepthEffect((), (), True, base)
    assert empty.displacements(np.array([0.5]))[0][0, 0, 0] == pytest.approx(0.25)
    assert empty.without_base is base
    assert base.without_base is base
    with pytest.raises(IndexError):  # the first place of the base is zero: there is no scale
        _ = DepthEffect((1.5,), (state(1.0),), True, DepthEffect((), (), True)).without_base


def test_the_most_suitable_depth_effect_reaches_as_far() -> None:
    near, far, other = effect_at(0.5, 2.0), effect_at(0.5, 4.0), effect_at(0.5, 2.0, by_turn=False)
    assert _most_suitable(np.array([0.6, 1.9]), True, (far, near, other)) is near
    assert _most_suitable(np.array([0.6, 1.9]), False, (far, near, other)) is other
    assert _most_suitable(np.array([0.6, 3.9]), True, (far, near)) is far
    assert _most_suitable(np.array([-0.6, 1.9]), True, (near,)) is None


def test_loads_on_a_straight_line_are_ordered_by_their_size() -> None:
    plain = Loads.along([0.0, 5.0, -10.0], gravity_angle_deg=None)
    assert _along_ray(plain) == pytest.approx([0.0, -0.5, 1.0])
    assert _along_ray(Loads.along([3.0, 3.0])).tolist() == [0.0, 0.0]  # type: ignore[union-attr]
    for off, is_straight in ((0.9e-8, True), (1.2e-8, False)):  # a millionth of the largest load of 0.01 T
        field = plain.field_T + np.array([[0.0, 0.0], [off, 0.0], [0.0, 0.0]])
        assert (_along_ray(replace(plain, field_T=field)) is not None) is is_straight


def test_a_table_of_a_field_has_cells_of_a_millimetre_and_reaches_half_as_far_behind_the_clamp() -> None:
    for reach, steps in ((10.0, 20), (30.0, 30), (30.2, 31), (150.0, 100)):
        table = FieldTable.of_loops(400.0, 400.0, (0.0, 0.0), (1.0, 0.0), reach)
        assert len(table.y_mm) == 2 * steps + 1
        assert (table.y_mm[0], table.y_mm[-1]) == pytest.approx((-reach, reach))
        assert len(table.x_mm) == 2 * steps + 1 - 3 * steps // 4
        assert table.covers(np.array([[table.x_mm[0], -reach], [reach, reach]]))
        assert not table.covers(np.array([[table.x_mm[0] - 0.1, 0.0]]))
        assert not table.covers(np.array([[reach + 0.1, 0.0]]))
        assert not table.covers(np.array([[0.0, -reach - 0.1]]))
        assert not table.covers(np.array([[0.0, reach + 0.1]]))


@pytest.mark.parametrize(("radius", "is_refused"), [(22.9, True), (23.1, False)])
def test_a_loop_within_three_cells_of_a_place_is_refused(radius: float, is_refused: bool) -> None:
    # The places reach 20 mm to the side, in cells of 1 mm; the loops stand at the ends of a gap of 2 mm.
    def table() -> FieldTable:
        return FieldTable.of_loops(radius, 2.0, (0.0, 0.0), (1.0, 0.0), 20.0)

    if is_refused:
        with pytest.raises(ValueError, match="from a place that the beam may reach"):
            table()
    else:
        assert table().field.shape == (26, 41, 2)


def test_shapes_that_are_sums_of_others_have_no_vibration_of_their_own() -> None:
    material, rest, mass = np.diag([4.0, 9.0]), np.diag([1.0, 2.0]), np.eye(2)
    shapes = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    three = [(shapes @ one @ shapes.T)[None] for one in (material, rest, mass)]
    assert squares_by_stiffening(*three, np.array([1.0, 2.0]), 2) == pytest.approx(
        np.array([[[5.0, 11.0], [9.0, 20.0]]])
    )
    assert squares_by_stiffening(*three, np.ones(1), 3)[0, 0, 2] > 1e17
    for factor, frequencies in ((2.2e-5, [5.0, 11.0]), (1.8e-5, [5.0])):
        # The smaller eigenvalue of the mass is a quarter of the square of this number: 1e-10 at 2e-5.
        nearly = np.array([[1.0, 0.0], [1.0, factor]])
        two = [(nearly @ one @ nearly.T)[None] for one in (material, rest, mass)]
        found = squares_by_stiffening(*two, np.ones(1), 2)[0, 0]
        assert found[: len(frequencies)] == pytest.approx(frequencies, rel=1e-3)
        assert bool(found[-1] > 1e17) is (len(frequencies) == 1)


def test_a_vibration_with_a_loss_factor_has_its_complex_rate() -> None:
    material, rest, mass = (np.array([[[value]]]) for value in (4.0, 1.0, 2.0))
    (found,) = complex_roots(material, rest, mass, lambda s: np.full_like(s, 1 + 0.2j))[0]
    assert found**2 == pytest.approx(-(4.0 * (1 + 0.2j) + 1.0) / 2.0)
    assert found.imag > 0
    assert np.isnan(complex_roots(material, -2 * material, mass, lambda s: np.ones_like(s))).all()


def test_modes_of_the_width_change_the_ends_by_their_amplitudes() -> None:
    plain = Specimen(40.0, 4.0, 5.0, 1070.0, "plane-stress")
    tapered, waisted = (Strip(with_modes(plain, (), one)).width_mm(np.array([0.0, 20.0, 40.0])) for one in
                        ((0.1, 0.0), (0.0, 0.1)))  # fmt: skip
    assert tapered == pytest.approx([3.9, 4.0, 4.1])
    assert waisted == pytest.approx([4.1, 3.95, 4.1])
    along = np.linspace(0, 1, 101)
    for mode in range(3):
        amplitudes = [0.0] * mode + [0.7]
        assert np.abs(bend_offset(amplitudes, along)).max() == pytest.approx(0.7)
    assert bend_offset((0.5,), along) == pytest.approx(0.5 * along**2)
    assert with_modes(plain, (0.0,), (0.0,)) is plain
    rows = with_modes(plain, (), (0.1,)).rest_shape
    assert rows is not None
    assert len(rows.widths) == 17
    few = replace(plain, rest_shape=RestShape(widths=((0.0, 0.2), (0.5, 0.3), (1.0, 0.2))))
    added = with_modes(few, (), (0.1,)).rest_shape
    assert added is not None
    at, values = np.array(added.widths).T
    assert values == pytest.approx(np.interp(at, [0, 0.5, 1], [0.2, 0.3, 0.2]) + 0.1 * (2 * at - 1))
    assert len(at) == 17


def arc(points: int, length_mm: float = 30.0, start: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    # Return points (x, y) on a quarter of a circle that begins along x.
    radius, turn = length_mm / (0.5 * np.pi), np.linspace(0.0, 0.5 * np.pi, points)
    return np.stack([radius * np.sin(turn), radius * (1 - np.cos(turn))], axis=1) + start


def test_a_measured_centre_line_begins_at_the_clamp_and_has_the_length_of_the_beam() -> None:
    for points, rows in ((4, 17), (8, 17), (9, 18), (20, 40)):
        table = np.array(centre_line(arc(points), 30.0))
        assert len(table) == rows
        assert table[:, 1] == pytest.approx(0.5 * np.pi * table[:, 0], abs=0.02)
    for shift in ((0.59, 0.0), (0.0, -0.59)):
        centre_line(arc(20, start=shift), 30.0)
    for shift in ((0.61, 0.0), (0.43, 0.43)):
        with pytest.raises(ValueError, match="but should begin at the clamp"):
            centre_line(arc(20, start=shift), 30.0)
    for length in (30.58, 29.42):
        centre_line(arc(20, length), 30.0)
    for length in (30.62, 29.38):
        with pytest.raises(
            ValueError, match=r"mm long, but the beam has length_mm = 30: the two lengths should differ"
        ):
            centre_line(arc(20, length), 30.0)
    with pytest.raises(ValueError, match="at least 4 points"):
        centre_line(arc(3), 30.0)
    with pytest.raises(ValueError, match="points 3 and 4 of the centre line are the same"):
        centre_line(arc(20)[[0, 1, 2, 2, *range(3, 20)]], 30.0)


def test_a_table_of_angles_is_a_cubic_from_four_rows_on() -> None:
    three = RestShape(turns=((0.0, 0.0), (0.5, 0.2), (1.0, 0.8)))
    assert three.angle_rad(np.array([0.25, 0.75, 1.5])) == pytest.approx([0.1, 0.5, 0.8])
    at = np.linspace(0, 1, 4)
    four = RestShape(turns=tuple(zip(at.tolist(), (at**3).tolist(), strict=True)))
    assert four.angle_rad(np.array([0.25, 0.75, 1.5])) == pytest.approx([0.25**3, 0.75**3, 1.0])


def test_a_slope_that_changes_by_half_of_the_largest_slope_is_a_kink() -> None:
    def kinks(*slopes: float) -> list[float]:
        at = np.linspace(0.0, 1.0, len(slopes) + 1)
        values = np.concatenate([[0.0], np.cumsum(np.array(slopes) * np.diff(at))])
        return RestShape(widths=tuple(zip(at.tolist(), values.tolist(), strict=True))).kinks.tolist()

    assert kinks(1.0, 0.51) == []
    assert kinks(1.0, 0.49) == [0.5]
    assert kinks(-1.0, 0.1, 0.1) == pytest.approx([1 / 3])
    assert kinks(0.0, 0.0) == []


def test_a_width_must_stay_positive_and_the_magnet_is_as_wide_as_its_narrowest_place() -> None:
    def strip(*rows: tuple[float, float], magnet: Magnet | None = None) -> Strip:
        return Strip(Specimen(40.0, 4.0, 5.0, 1070.0, "plane-stress", magnet, rest_shape=RestShape(widths=rows)))

    assert strip((0.0, 0.0), (1.0, -3.9)).width_mm(np.array([40.0])) == pytest.approx([0.1])
    with pytest.raises(ImpossibleShape, match="width_mm of the rest shape falls to 0 mm, but must be above 0 mm"):
        strip((0.0, 0.0), (1.0, -4.0))
    with pytest.raises(ImpossibleShape, match=r"falls to -0\.1 mm"):
        strip((0.0, 0.0), (0.5, -4.1), (1.0, 0.0))
    magnet = Magnet(8.0, 2.0, 2.0, 1.2, 7500.0)
    assert strip((0.0, 1.0), (1.0, 0.2), magnet=magnet).straight.width_mm == pytest.approx(4.2)
    assert strip((0.0, 0.2), (1.0, 1.2), magnet=magnet).straight.width_mm == pytest.approx(5.0)


def test_a_motion_in_time_needs_plane_stress_and_divides_a_step_at_most_64_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    series, loads = Prony(np.array([0.1]), np.array([1.0])), Loads.along([0.0])
    with pytest.raises(ValueError, match='"plane-stress", not "plane-strain"'):
        Transient(BeamModel(BEAM, 2, 1, "plane-strain"), NEO_HOOKEAN, np.array([40e3]), series, loads)
    motion = Transient(BeamModel(BEAM, 2, 1), NEO_HOOKEAN, np.array([40e3]), series, loads)
    parts: list[float] = []

    def fail(self: Transient, step_s: float, *given: Any) -> None:
        parts.append(step_s)
        raise NotSolved

    monkeypatch.setattr(Transient, "_advance", fail)
    with pytest.raises(NotSolved, match=r"between 0 s and 1 s, even in 64 parts"):
        motion.advance(1.0, loads)
    assert parts == [1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64]
    assert motion.time_s == 0.0
    at_rest = motion.shapes()
    assert (at_rest.last.pressure.shape[1], at_rest.last.stress.shape[2]) == (1, 1)
    assert at_rest.displacement.shape[:2] == (1, 1)


@pytest.mark.parametrize(("reach_mm", "spacing_mm"), [(10.0, 0.5), (40.0, 1.0), (200.0, 2.0)])
def test_a_coil_loop_may_not_come_closer_than_three_spacings_of_its_table(reach_mm: float, spacing_mm: float) -> None:
    def table(distance_mm: float) -> FieldTable:
        centre_mm = (reach_mm + distance_mm + 30.0, 0.0)  # both loops pass x = reach + distance, at y = -10 and y = 10
        return FieldTable.of_loops(30.0, 20.0, centre_mm, (0.0, 1.0), reach_mm)

    with pytest.raises(ValueError, match="a coil loop of radius 30 mm lies"):
        table(2.98 * spacing_mm)
    assert np.isfinite(table(3.02 * spacing_mm).field).all()
