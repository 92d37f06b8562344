"""Numbers between 0 and 1, which the search uses, are converted to parameters of a law."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.laws import search_space


def test_search_space_covers_its_bounds_and_keeps_the_modulus(row):
    space, law = search_space(row.law), row.law
    rng = np.random.default_rng(0)
    unit = rng.uniform(size=(200, len(space.names)))
    parameters = space.parameters(unit)
    assert parameters.shape == (200, len(law.parameter_names))
    # The first coordinate is the initial shear modulus for any values of the others.
    assert law.initial_shear_modulus(parameters) == pytest.approx(space.physical(unit)[:, 0], rel=1e-12)
    corners = space.physical(np.array([np.zeros(len(space.names)), np.ones(len(space.names))]))
    assert corners[0] == pytest.approx(space.lower)
    assert corners[1] == pytest.approx(space.upper)


def test_moduli_are_in_proportion_to_the_first_coordinate(row):
    law, space = row.law, search_space(row.law)
    x = space.physical(np.random.default_rng(1).uniform(size=(50, len(space.names))))
    twice = law.from_coordinates(x * np.array([2.0] + [1.0] * (len(space.names) - 1)))
    factor = np.array([2.0 if unit == "Pa" else 1.0 for unit in law.units])
    assert twice == pytest.approx(factor * law.from_coordinates(x), rel=1e-12)


def test_the_bulk_modulus_coordinate_leaves_the_bending_stiffness_unchanged(row):
    space = search_space(row.law).with_bulk()
    unit = np.random.default_rng(2).uniform(size=(50, len(space.names)))
    mu, bulk = row.law.initial_shear_modulus(space.parameters(unit)), space.bulk_modulus_Pa(unit)
    x = space.physical(unit)
    assert mu * (3 * bulk + mu) / (3 * bulk + 4 * mu) == pytest.approx(x[:, 0], rel=1e-12)
    assert np.log10(bulk / mu) == pytest.approx(x[:, -1], rel=1e-12)
