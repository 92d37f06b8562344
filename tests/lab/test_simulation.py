"""`eimi simulate`: what it writes agrees with itself and with the measured metric's edges."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from eimi_lab.config.specimen import load_specimen
from eimi_lab.errors import InputError
from eimi_lab.simulation import parse_parameters, simulate, write_simulation


def test_files_of_a_simulation(tmp_path: Path) -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    write_simulation(tmp_path, simulate(load_specimen("type1"), law, values, np.array([0.0, 3.5, 7.05]), 0.0))
    tip = np.genfromtxt(tmp_path / "tip.csv", delimiter=",", names=True)
    assert tip["angle_deg"][-1] == pytest.approx(52.4, abs=0.2)
    assert tip["x_mm"][0] == pytest.approx(30.0, abs=0.1)
    left = np.loadtxt(tmp_path / "state_02_left.csv", delimiter=",", skiprows=1)
    right = np.loadtxt(tmp_path / "state_02_right.csv", delimiter=",", skiprows=1)
    assert 0.5 * (left[-1] + right[-1]) == pytest.approx([tip["x_mm"][-1], tip["y_mm"][-1]], abs=1e-5)
    vtu = meshio.read(tmp_path / "state_02.vtu")
    place = vtu.points + vtu.point_data["displacement_mm"]
    corners = vtu.cells[0].data[:, :4]
    # Corners in order round each cell, moved: every cell keeps its area to within the compressibility.
    x, y = place[corners][..., 0], place[corners][..., 1]
    area = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)
    assert area.sum() == pytest.approx(26 * 3, rel=0.01)
    assert np.all(area > 0)
    assert vtu.cell_data["largest_stretch"][0].max() == pytest.approx(tip["max_stretch"][-1], abs=1e-5)
    assert (tmp_path / "shapes.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("model", "parameters", "told"),
    [
        ("hooke", ["mu_Pa=1"], "--model hooke: should be one of neo-hookean"),
        ("neo-hookean", ["mu=1"], "takes mu_Pa, each once; got mu=1"),
        ("neo-hookean", ["mu_Pa=soft"], "--parameter mu_Pa=soft: should be KEY=NUMBER"),
        ("yeoh", ["C10_Pa=1", "C10_Pa=1", "C30_Pa=1"], "takes C10_Pa, C20_Pa, C30_Pa, each once"),
    ],
)
def test_bad_parameters_are_told_in_one_line(model: str, parameters: list[str], told: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_parameters(model, parameters)
    assert told in str(caught.value)


def test_a_law_without_equilibrium_is_told_with_its_state() -> None:
    law, values = parse_parameters("yeoh", ["C10_Pa=25000", "C20_Pa=-100000", "C30_Pa=0"])
    with pytest.raises(InputError, match=r"specimen type1: yeoh at .* mT: (unstable|diverged|out of iterations)"):
        simulate(load_specimen("type1"), law, values, np.array([0.0, 3.5, 30.0]), 0.0)
