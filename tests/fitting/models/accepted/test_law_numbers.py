"""Energies, limits of stability, tensile fits, relaxation and cards of each law give the accepted numbers."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.laws import LAWS, SOLVERS, Law, engineering_stress, fit_tensile, material_card
from eimi_fitting.laws.cards import Material
from eimi_fitting.laws.law import CannotFit, NotInSolver
from eimi_fitting.laws.ogden import _cosh_of_scaled_angle, _number_of_terms
from eimi_fitting.laws.prony import Prony
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.stability import scanned_limit, smallest_positive_root, stable_stretch, stable_up_to
from eimi_fitting.laws.stable_cells import proved_stable
from eimi_fitting.laws.sum_of_terms import SumOfTerms
from examples.arruda_boyce import ArrudaBoyce
from tests.shared.accepted_numbers import check
from tests.shared.scaled_numbers import of

ACCEPTED = Path(__file__).parent / "laws"
SUM = SumOfTerms.of("i1^2", "i1", "i2", "gent=20", "i1^3", "fung=0.3", "ogden=-4", "ogden=3", "ogden=6", "ogden=9")
PARAMETERS: dict[str, tuple[Law, list[float]]] = {
    "neo-hookean": (LAWS["neo-hookean"], [46e3]),
    "mooney-rivlin": (LAWS["mooney-rivlin"], [20e3, 4e3]),
    "yeoh": (LAWS["yeoh"], [19.5e3, 3e3, 400.0]),
    "ogden": (LAWS["ogden"], [20e3, 1.7, 300.0, 5.0, -6e3, -2.0]),
    "arruda-boyce": (ArrudaBoyce(), [40e3, 2.5]),
    "sum of terms": (SUM, [2e3, 20e3, 6e3, 10e3, 90.0, 4e3, 3e3, 2e3, 1e3, 500.0]),
}
A = np.array([2.0, 2.05, 2.6, 4.1, 9.0, 3.0])
J = np.array([1.0, 0.98, 1.1, 0.9, 1.6, 0.6])
STRETCHES = np.array([[1.0, 1.0, 1.0], [1.4, 0.9, 1 / 1.26], [2.5, 0.5, 0.8], [0.4, 1.9, 1 / 0.76]])


def compare(lines: Iterable[str], name: str, folder: Path) -> None:
    check(lines, ACCEPTED / name, folder, relative=1.1e-5, absolute=1e-9)


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_law_has_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    law, values = PARAMETERS[name]
    if isinstance(law, SumOfTerms):
        law = SumOfTerms.of(*(term.name for term in law.terms))
    parameters = np.array(values)
    both = np.stack([parameters, 1.2 * parameters])[:, None]
    space = search_space(law)
    middle = np.full((2, len(space.names)), 0.4) + np.arange(len(space.names)) * np.array([[0.05], [0.02]])
    bulky = space.with_bulk()
    in_bulk = np.column_stack([middle, [0.3, 0.7]])
    parts = {
        "name": [law.name, law.formula, *law.parameter_names, *law.units],
        "coordinates": [[c.name, c.lower, c.upper] for c in law.coordinates],
        "plane stress": law.planar(both, np.stack([A, A]), np.stack([J, J]), "plane-stress"),
        "plane strain": law.planar(both, np.stack([A, A]), np.stack([J, J]), "plane-strain"),
        "principal": law.principal(both, STRETCHES),
        "modulus": law.initial_shear_modulus(both[:, 0]),
        "stress": engineering_stress(law, parameters, np.array([-0.3, 0.0, 0.2, 1.5])),
        "from coordinates": space.parameters(middle),
        "with a bulk modulus": [bulky.parameters(in_bulk), bulky.bulk_modulus_Pa(in_bulk), bulky.physical(in_bulk)],
        "space": [*bulky.names, *map(str, bulky.lower), *map(str, bulky.upper), str(bulky.has_bulk)],
    }
    compare(of(parts, law.name), f"{name}.txt", tmp_path)


@pytest.mark.parametrize("name", PARAMETERS)
def test_energies_have_their_derivatives(name: str) -> None:
    law, values = PARAMETERS[name]
    parameters, h = np.array(values), 1e-5
    for section in ("plane-stress", "plane-strain"):
        for a, volume in zip(A[1:], J[1:], strict=True):

            def at(more_a: float, more_J: float, a=a, volume=volume, section=section) -> tuple[float, float, float]:
                found = law.planar(parameters, np.array([a + more_a]), np.array([volume + more_J]), section)  # type: ignore[arg-type]
                return float(found.value[0]), float(found.a[0]), float(found.J[0])

            found = law.planar(parameters, np.array([a]), np.array([volume]), section)  # type: ignore[arg-type]
            by_a = (np.array(at(h, 0)) - np.array(at(-h, 0))) / (2 * h)
            by_J = (np.array(at(0, h)) - np.array(at(0, -h))) / (2 * h)
            size = 1e-6 * float(np.abs(np.concatenate([part for part in found])).max())
            assert by_a == pytest.approx([found.a[0], found.aa[0], found.aJ[0]], rel=1e-6, abs=size)
            assert by_J == pytest.approx([found.J[0], found.aJ[0], found.JJ[0]], rel=1e-6, abs=size)
    log = np.log(STRETCHES)
    _, gradient, hessian = law.principal(parameters, STRETCHES)
    for i in range(3):
        step = h * (np.arange(3) == i)
        up, down = law.principal(parameters, np.exp(log + step)), law.principal(parameters, np.exp(log - step))
        size = 1e-6 * float(np.abs(hessian).max())
        assert (up[0] - down[0]) / (2 * h) == pytest.approx(gradient[:, i], rel=1e-6, abs=size)
        assert (up[1] - down[1]) / (2 * h) == pytest.approx(hessian[:, :, i], rel=1e-6, abs=size)


@pytest.mark.parametrize("nu2", [1.0, 16.0, 50.0])
@pytest.mark.parametrize("k", range(2, 9))
def test_the_series_ends_where_the_next_term_of_the_second_derivative_has_no_effect(nu2: float, k: int) -> None:
    # Term k of the series is c z^(k + 1), and that of its second derivative is (k + 1) k c z^(k - 1).
    c = float(np.prod([(nu2 + i * i) / ((2 * i + 1) * (i + 1)) for i in range(k + 1)]))
    z = (1e-16 / (c * (k + 1) * k)) ** (1 / (k - 1))
    assert _number_of_terms(nu2, 0.9999 * z) == k + 1
    assert _number_of_terms(nu2, 1.0001 * z) == k + 2
    assert _number_of_terms(nu2, 10.0) == 10


@pytest.mark.parametrize("nu", [0.5, 3.0, -2.0, 8.0])
@pytest.mark.parametrize("far", [False, True])
def test_the_series_and_the_closed_form_agree_with_chebyshevs_equation(nu: float, far: bool) -> None:
    # g = cosh(nu arccosh c) fulfils (c^2 - 1) g'' + c g' = nu^2 g.
    near = min(0.1, 2.0 / nu**2)
    c = 1 + (np.array([1.0001, 1.5, 10.0]) if far else np.array([1e-9, 1e-5, 0.01, 0.5, 0.9999])) * near
    g, g1, g2 = _cosh_of_scaled_angle(np.full(len(c), nu), c)
    assert g == pytest.approx(np.cosh(nu * np.arccosh(c)), rel=1e-12)
    assert (c * c - 1) * g2 + c * g1 == pytest.approx(nu**2 * g, rel=1e-10)
    h = 1e-5 * (c - 1)
    up, down = (_cosh_of_scaled_angle(np.full(len(c), nu), c + step) for step in (h, -h))
    assert g1[3 - 3 * far :] == pytest.approx(((up[0] - down[0]) / (2 * h))[3 - 3 * far :], rel=1e-6)
    assert g2[3 - 3 * far :] == pytest.approx(((up[1] - down[1]) / (2 * h))[3 - 3 * far :], rel=1e-6)


def test_the_closed_form_takes_over_from_the_series_at_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[np.ndarray] = []
    whole = np.arccosh
    monkeypatch.setattr(np, "arccosh", lambda x: taken.append(x) or whole(x))
    _cosh_of_scaled_angle(np.array([1.0]), np.array([1.0999]))
    _cosh_of_scaled_angle(np.array([5.0, 1.0]), np.array([1.0799, 1.0]))
    assert not taken
    _cosh_of_scaled_angle(np.array([1.0, 1.0]), np.array([1.1001, 1.05]))
    _cosh_of_scaled_angle(np.array([5.0, 1.0]), np.array([1.0801, 1.05]))
    assert [values.tolist() for values in taken] == [pytest.approx([1.1001, 2.0]), pytest.approx([1.0801, 2.0])]


def test_limits_of_stability_have_the_accepted_numbers(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    largest = np.array([1.2, 2.0, 3.5, 6.0] * 5)
    lines: list[str] = []
    for name, (law, values) in PARAMETERS.items():
        factors = rng.uniform(-0.4, 1.0, (20, len(values)))
        dimensionless = np.array([unit == "1" for unit in law.units])
        factors[:, dimensionless] = rng.uniform(0.9, 1.1, (20, int(dimensionless.sum())))
        many = factors * np.array(values)
        with np.errstate(all="ignore"):
            parts = {
                "limit": law.drucker_limit(many, largest),
                "stable": stable_stretch(law, many, largest),
                "scanned": scanned_limit(law, many[:8], largest[:8]),
                "up to": [stable_up_to(law, row) or 0.0 for row in many[:8]],
            }
        lines += of(parts, name)
    weight, alpha = rng.normal(0.5, 1.0, (20, 3)), rng.uniform(-5, 8, (20, 3))
    lines += of(proved_stable(weight, alpha, np.log(largest)), "proved")
    roots = smallest_positive_root(np.column_stack([np.abs(rng.normal(0, 1, 20)), rng.normal(0, 1, (20, 4))]))
    lines += of(roots, "roots")
    compare(lines, "limits.txt", tmp_path)


CURVE = np.concatenate([np.linspace(0.02, 0.6, 15), np.linspace(0.7, 2.0, 12)])
NOISE = 120.0 * np.sin(np.arange(27) * 2.3) + 60.0 * np.cos(np.arange(27) * 0.7)


@pytest.mark.parametrize("name", ["neo-hookean", "mooney-rivlin", "yeoh", "ogden", "arruda-boyce", "two terms"])
def test_tensile_fits_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    law = SumOfTerms.of("i1", "i1^2") if name == "two terms" else PARAMETERS[name][0]
    measured = engineering_stress(LAWS["yeoh"], np.array([19.5e3, 900.0, 60.0]), CURVE) + NOISE
    plain = fit_tensile(law, CURVE, measured, largest_strain=1.9)
    measured[3] = -5.0
    relative = fit_tensile(law, CURVE, measured, relative=True)
    described = [{k: v for k, v in vars(fit).items() if k != "law"} for fit in (plain, relative)]
    tolerance = 1e-3 if name in ("ogden", "arruda-boyce") else 1.1e-5  # the search ends with an accuracy of its own
    lines = of(described, name)
    check(lines, ACCEPTED / f"tensile fit, {name}.txt", tmp_path, relative=tolerance, absolute=0.01 * tolerance)


def test_fits_that_cannot_be_are_refused_with_their_reason() -> None:
    strain = np.linspace(0.1, 0.5, 4)
    for rows, words in [(4, "4 rows can be used, but a fit of the ogden law needs at least 7 rows"), (1, "1 row can")]:
        with pytest.raises(CannotFit, match=words):
            fit_tensile(LAWS["ogden"], strain[:rows], strain[:rows])
    many = np.linspace(0.1, 0.5, 8)
    for law in (LAWS["ogden"], ArrudaBoyce()):
        with pytest.raises(CannotFit, match="every stress is zero"):
            fit_tensile(law, many, 0 * many)
        with pytest.raises(CannotFit, match="check the signs of strain and stress"):
            fit_tensile(law, many, -many)


SERIES = Prony(np.array([0.15, 0.08]), np.array([0.04, 0.7]))


def test_prony_series_have_the_accepted_numbers(tmp_path: Path) -> None:
    several = Prony(np.array([[0.15, 0.08], [0.05, 0.3]]), np.array([[0.04, 0.7], [0.2, 3.0]]))
    times = np.array([0.0, 0.01, 0.5, 20.0])
    lines: list[str] = []
    for name, series in [("one", SERIES), ("several", several)]:
        parts = {
            "long term": series.long_term,
            "ratio": series.ratio(times),
            "at one time": series.ratio(0.3),
            "creep": [series.creep(time) for time in (0.0, 0.2, 30.0)],
            "complex": series.complex_ratio(np.array([[1 + 3j, -0.2 + 20j], [2j, 0.5 + 0j]][: series.g.ndim])),
            "loss": series.loss_factor(np.array([0.5, 8.0])),
            "loss at one frequency": series.loss_factor(4.0),
        }
        lines += of(parts, name)
    compare(lines, "series.txt", tmp_path)


@pytest.mark.parametrize("name", PARAMETERS)
def test_cards_have_the_accepted_texts(name: str, tmp_path: Path) -> None:
    law, values = PARAMETERS[name]
    one_term = np.array([0.0, 2.0, 300.0, 5.0, 0.0, -2.0]) if name == "ogden" else np.array(values)
    lines: list[str] = []
    for solver in [*SOLVERS, "another"]:
        for relaxation in (None, SERIES):
            parameters = one_term if solver == "sofa" else np.array(values)
            material = Material(law, parameters, 90e6, "SILICONE", ("from -- a test",), relaxation)
            try:
                card = material_card(solver, material) if solver in SOLVERS else str(material.constants_for(solver))
            except NotInSolver as refused:
                card = f"refused: {refused}"
            lines += [f"{solver}, {'relaxing' if relaxation else 'elastic'}", *card.splitlines()]
    compare(lines, f"cards, {name}.txt", tmp_path)
