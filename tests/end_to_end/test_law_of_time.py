"""A fit to free vibrations and creep of the virtual rig finds the viscoelastic law."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_fitting.laws.prony import Prony

PROTOCOLS = Path(__file__).parents[2] / "protocols"
AT_REST_PA, H, TAU_S = 46390.0, np.array([0.12, 0.1]), np.array([0.05, 2.0])
HIDDEN = Prony(H / (1 + H.sum()), TAU_S)
INSTANTANEOUS_PA = AT_REST_PA * (1 + H.sum())
MATERIALS = f"""
[silicone."Dragon Skin 10"]
model = "neo-hookean"
parameters = {{ mu_Pa = {AT_REST_PA} }}
prony_h = {H.tolist()}
prony_tau_s = {TAU_S.tolist()}
"""
PROTOCOL = """
name = "time"
material = "Dragon Skin 10"
frames_per_state = 1
creep = true
transients = {{ frames_per_state = 24 }}
ring_down = {{ seconds = 3.0, rate_Hz = 40.0, repeats = {repeats} }}
current = {{ values_A = {currents_A} }}
ramp = {{ rate_A_per_s = 20.0, step_A = 0.75, tolerance_A = 0.02 }}
limits = {{ current_A = 1.6, voltage_V = 24.0 }}
settle = {{ noise_ratio = 1.5, pairs = 2, drift_window_s = 0.5, dwell_s = {dwell_s}, timeout_s = 10.0 }}
"""


@pytest.mark.parametrize(
    ("mesh", "repeats", "currents_A", "dwell_s", "of_modulus", "of_law"),
    [
        pytest.param("[8, 1, 1]", 1, [0.0, 1.5], 4.0, 0.01, None, id="short"),
        pytest.param("[14, 2, 1]", 2, [0.0, 0.75, 1.5], 8.0, 0.005, 0.02, id="whole", marks=pytest.mark.slow),
    ],
)
def test_one_fit_identifies_the_hidden_viscoelastic_law(
    done: Callable[..., str],
    tmp_path: Path,
    mesh: str,
    repeats: int,
    currents_A: list[float],
    dwell_s: float,
    of_modulus: float,
    of_law: float | None,
) -> None:
    for file in (PROTOCOLS / "rigs").glob("virtual*.toml"):
        shutil.copy(file, tmp_path)
    rig, calibration = tmp_path / "virtual.toml", tmp_path / "virtual_calibration.toml"
    rig.write_text(rig.read_text().replace("[1280, 1024]", "[320, 256]").replace("[26, 3, 1]", mesh))
    calibration.write_text(
        calibration.read_text().replace("= 25.0", "= 6.25").replace("[640.0, 80.0]", "[160.0, 20.0]")
    )
    (tmp_path / "virtual_materials.toml").write_text(MATERIALS)
    protocol = PROTOCOL.format(repeats=repeats, currents_A=currents_A, dwell_s=dwell_s)
    (tmp_path / "protocol.toml").write_text(protocol)
    done("acquire", "protocol.toml", "--specimen", "type1", "--rig", "virtual.toml", "-o", "run.h5", folder=tmp_path)
    with h5py.File(tmp_path / "run.h5", "r+", libver="latest") as file:
        del file["entry/truth"]
    done("fit", "run.h5", "--model", "neo-hookean", "--time", "prony", "-o", "fits.json", folder=tmp_path)
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    time = fit["time"]
    value = INSTANTANEOUS_PA * complex(HIDDEN.complex_ratio(np.array(2j * np.pi * time["frequency_Hz"])))
    assert len(time["ring_downs"]) == repeats
    assert time["dynamic_shear_modulus"]["value"] == pytest.approx(value.real, rel=of_modulus)
    assert time["loss_factor"] == pytest.approx(value.imag / value.real, rel=0.05)
    if of_law:
        low, high = time["dynamic_shear_modulus"]["interval_95"]
        assert low < value.real < high
        terms = np.array([[term["g"], term["tau_s"]] for term in time["prony"]])
        times_s = np.geomspace(0.03, 30.0, 13)
        fitted_Pa = time["instantaneous_shear_modulus"]["value"] * Prony(terms[:, 0], terms[:, 1]).ratio(times_s)
        assert fitted_Pa == pytest.approx(INSTANTANEOUS_PA * HIDDEN.ratio(times_s), rel=of_law)
