"""The published edge methods in the benchmark have the same errors as independent implementations."""

import numpy as np
import pytest

from tests.shared.edge_methods import METHODS
from tests.shared.rendered_edges import NOMINAL, measure, measure_other, overall

# Bias and RMS error (px) of independent implementations on the same frames.
OTHER_IMPLEMENTATIONS = {"Otsu + contours": (-0.64, 0.71), "marching squares": (-0.175, 0.18), "Devernay": (0.0, 0.010)}


@pytest.mark.parametrize("name", METHODS)
def test_published_methods_have_their_known_errors(name):
    row = measure_other(METHODS[name], NOMINAL, (-40.0, 20.0), seed=1)
    bias, spread = OTHER_IMPLEMENTATIONS[name]
    for side in ("left", "right"):
        assert row[f"{side}_bias"] == pytest.approx(bias, abs=0.12)
        assert row[f"{side}_rms"] == pytest.approx(spread, abs=0.12)


def test_the_edge_search_has_smaller_errors_than_its_limits():
    row = overall(measure(NOMINAL, (-40.0, 20.0), frames=2, seed=1))
    assert max(abs(row["left_bias"]), abs(row["right_bias"])) < 0.01
    assert max(row["left_rms"], row["right_rms"]) < 0.03
    assert 0.8 < row["pull"] < 1.25
    assert np.isfinite(row["ms"])
