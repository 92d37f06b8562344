"""Every script in examples/ runs and returns the right number."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
NUMBERED = sorted(path.name for path in EXAMPLES.glob("[0-9]*.py"))
EXPECTED: dict[str, Any] = {
    "01_bend_a_beam.py": pytest.approx(1.0, abs=2e-3),  # a slender beam bends as beam theory predicts
    "02_fit_a_virtual_dataset.py": pytest.approx(1.0, abs=1e-3),
    "03_fit_tracked_points.py": pytest.approx(46e3, rel=0.01),
    "04_fit_a_tensile_curve.py": pytest.approx(
        40e3, rel=1e-6
    ),  # twice the C10 of the law with which the curve was computed
    "05_write_a_material_card.py": pytest.approx(0.023),  # half of the shear modulus, in MPa
    "06_try_a_protocol_dry.py": 16,  # from 0 to 1.5 A in steps of 0.1 A
    "07_drive_an_emulated_supply.py": pytest.approx(0.7, abs=2e-3),
    "08_import_a_folder_of_pictures.py": pytest.approx(600, rel=0.05),  # about a hundred points for each edge
    "09_error_of_edges.py": pytest.approx(0.0, abs=0.06),
    "10_what_the_data_fix.py": pytest.approx(
        1.0, abs=1e-6
    ),  # C10 + C01, on which alone the edges depend in plane strain
}


@pytest.mark.parametrize("name", NUMBERED)
def test_an_example_returns_its_number(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    assert text.count("\n") <= 40
    assert runpy.run_path(str(EXAMPLES / name))["main"]() == EXPECTED[name]
    assert capsys.readouterr().out
    assert name in (EXAMPLES / "README.md").read_text(encoding="utf-8")
