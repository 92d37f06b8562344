"""The hyperelastic laws under test: a test with the argument ``row`` runs once for each law in ROWS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import strategies as st

from eimi_fitting.laws import LAWS, SOLVERS, Law
from eimi_fitting.laws.sum_of_terms import SumOfTerms
from examples.arruda_boyce import ArrudaBoyce


@dataclass(frozen=True, kw_only=True)
class Row:
    # A law and the inputs of its tests.
    # energy : parameters in MPa for which the stress is far from linear
    # silicone : parameters in Pa, none of them zero, for which the law is stable
    # candidates : generator (package Hypothesis) of parameters of any sign
    # recovered : relative tolerance of the parameters that a tensile fit returns; None if they are not unique
    # refused : finite-element programs for which the law has no material card (input)
    # volume_pressure : derivative dU/dJ of the volume energy U in a card, from bulk modulus and volume ratio J

    law: Law
    energy: list[float]
    silicone: list[float]
    candidates: st.SearchStrategy
    recovered: float | None = 1e-6
    refused: tuple[str, ...] = ()
    volume_pressure: Callable[[float, float], float] = lambda bulk, J: bulk * (J - 1)


coefficient = st.floats(1e-6, 1.0) | st.floats(-1.0, -1e-6) | st.just(0.0)
exponent = st.floats(0.5, 8.0) | st.floats(-8.0, -0.5)

ROWS = [
    Row(
        law=LAWS["neo-hookean"],
        energy=[0.046],
        silicone=[46e3],
        candidates=st.tuples(coefficient),
    ),
    Row(
        law=LAWS["mooney-rivlin"],
        energy=[0.02, 0.004],
        silicone=[20e3, 4e3],
        candidates=st.tuples(coefficient, coefficient),
    ),
    Row(
        law=LAWS["yeoh"],
        energy=[0.022, 0.005, -0.0006],
        silicone=[19.5e3, 3e3, 400.0],
        candidates=st.tuples(st.floats(0.1, 1.0), coefficient, coefficient.map(lambda c: 0.2 * c)),
        refused=("sofa",),
    ),
    Row(
        law=LAWS["ogden"],
        energy=[0.03, 1.7, 0.001, 8.0, -0.01, -2.5],
        silicone=[20e3, 1.7, 300.0, 5.0, -6e3, -2.0],
        candidates=st.tuples(coefficient, exponent, coefficient, exponent, coefficient, exponent),
        recovered=None,  # one tensile curve does not distinguish the terms
        refused=("sofa",),
    ),
    Row(
        law=SumOfTerms.of("i1", "i1^2", "i2", "gent=200", "fung=0.05", "ogden=-4"),
        energy=[0.02, 0.002, 0.006, 0.01, 0.004, 0.003],
        silicone=[20e3, 2e3, 6e3, 10e3, 4e3, 3e3],
        candidates=st.tuples(*[coefficient] * 6),
        recovered=1e-4,  # the stresses of the six terms are nearly linearly dependent
        refused=SOLVERS,
    ),
    Row(
        law=ArrudaBoyce(),
        energy=[0.03, 2.5],
        silicone=[40e3, 2.5],
        candidates=st.tuples(coefficient, st.floats(1.2, 10.0)),
        refused=("sofa",),
        volume_pressure=lambda bulk, J: 0.5 * bulk * (J - 1 / J),
    ),
]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "row" in metafunc.fixturenames:
        metafunc.parametrize("row", ROWS, ids=[row.law.name for row in ROWS])
