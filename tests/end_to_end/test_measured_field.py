"""After a run with an emulated gaussmeter, the fit uses the measured field, and not a wrong coil constant."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from eimi_lab.config.toml import locate
from eimi_lab.dataset.reading import open_dataset

TRUE_PA, TRUE_MT_PER_A, OFFSET_MT = 46390.0, 4.4, 0.05

SENSORS = """
[[sensors]]
name = "hall"
driver = "lakeshore-425"
address = "virtual"
measures = "field"
uncertainty = 0.005
uncertainty_share = 0.002

[[sensors]]
name = "air"
driver = "text-line"
address = "virtual"
measures = "specimen_temperature"
"""

PROTOCOL = """
name = "measured"
material = "Dragon Skin 10"
frames_per_state = 2

[current]
values_A = [0.0, 0.45, 0.9]

[ramp]
rate_A_per_s = 0.5
step_A = 0.05
tolerance_A = 0.02
down_within_s = 2.0

[limits]
current_A = 1.2
voltage_V = 12.0

[settle]
noise_ratio = 1.2
pairs = 3
drift_window_s = 1.0
timeout_s = 30.0
"""


def write_bench(folder: Path, sensors: str) -> None:
    # Write a virtual rig whose true magnetic field differs from its calibration.
    # sensors : sensors of the rig as TOML
    rig = locate("virtual", "rigs").read_text().replace("mesh = [26, 3, 1]", "mesh = [10, 2, 1]") + sensors
    (folder / "rig.toml").write_text(rig)
    (folder / "virtual_calibration.toml").write_text(locate("virtual_calibration", "rigs").read_text())
    bench = f"\n[bench]\ncoil_constant_mT_per_A = {TRUE_MT_PER_A}\nbackground_field_mT = [{OFFSET_MT}, 0.0]\n"
    (folder / "virtual_materials.toml").write_text(locate("virtual_materials", "rigs").read_text() + bench)
    (folder / "protocol.toml").write_text(PROTOCOL)


def modulus_Pa(folder: Path) -> float:
    # Return the initial shear modulus (Pa) of the fit in a folder.
    (fit,) = json.loads((folder / "fits.json").read_text())["fits"]
    return float(fit["initial_shear_modulus"]["value"])


@pytest.mark.slow  # test_bench.py fits with a measured field in the default run
def test_a_fit_uses_the_field_that_a_gaussmeter_measured(done: Callable[..., list[str]], tmp_path: Path) -> None:
    moduli = []
    for name, sensors in (("typed", ""), ("measured", SENSORS)):
        folder = tmp_path / name
        folder.mkdir()
        write_bench(folder, sensors)
        done("acquire", "protocol.toml", "--specimen", "type1", "--rig", "rig.toml", "-o", "run.h5", folder=folder)
        lines = done("fit", "run.h5", "--model", "neo-hookean", "-o", "fits.json", folder=folder)
        moduli.append(modulus_Pa(folder))
    assert any("hall (LSCI,MODEL425,4250022,1.0) measured at 3 currents, 4.4" in line for line in lines), lines
    assert any("run.h5: the specimen was at 23.0 °C" in line for line in lines), lines
    with open_dataset(tmp_path / "measured" / "run.h5") as dataset:
        line = dataset.field_line
        assert line is not None
        assert line.mT_per_A == pytest.approx(TRUE_MT_PER_A, abs=3 * line.mT_per_A_sigma)
        assert line.offset_mT == pytest.approx(OFFSET_MT, abs=3 * line.offset_mT_sigma)
        assert [state.temperature_degC for state in dataset.states] == pytest.approx([23.0] * 3, abs=0.1)
    (fit,) = json.loads((tmp_path / "measured" / "fits.json").read_text())["fits"]
    (reference,) = fit["datasets"]
    assert reference["measured_field"]["mT_per_A"] == line.mT_per_A
    assert reference["measured_field"]["offset_mT_sigma"] == line.offset_mT_sigma
    assert reference["measured_field"]["source"].startswith("hall (LSCI,MODEL425")
    assert reference["temperature"]["mean_degC"] == pytest.approx(23.0, abs=0.1)
    (fit,) = json.loads((tmp_path / "typed" / "fits.json").read_text())["fits"]
    assert not {"measured_field", "temperature"} & set(fit["datasets"][0])
    typed, measured = moduli
    assert abs(measured / TRUE_PA - 1) < 0.02
    assert abs(typed / TRUE_PA - 1) > 0.04
