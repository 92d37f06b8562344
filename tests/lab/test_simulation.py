"""The files of `eimi simulate` agree with each other and with the simulated edges."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from eimi_fitting import BeamModel, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.specimen import Section
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.simulation import _seen_from_the_side, parse_parameters, simulate, write_simulation
from tests.patience import PATIENCE_S


def planar(name: str) -> SpecimenFile:
    # Return a specimen of the program in plane strain.
    text = load_specimen(name).text
    return parse(SpecimenFile, re.sub(r'section = "solid"', 'section = "plane-strain"', text), name)


@pytest.mark.parametrize("section", ["plane-stress", "solid"])
def test_the_elements_of_a_side_view_fill_the_side_of_the_beam(section: Section) -> None:
    beam = Specimen(30.0, 3.0, 10.0, 1070.0, section)
    model = SolidBeside(beam, 4, 2, 1) if section == "solid" else BeamModel(beam, 4, 2)
    shown, outlines = _seen_from_the_side(model)
    x, y = np.moveaxis(model.mesh.nodes[outlines][..., :2], -1, 0)
    areas = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)
    assert len(areas) == 8
    assert areas.sum() == pytest.approx(np.sign(areas[0]) * 30.0 * 3.0)
    assert np.abs(areas).sum() == pytest.approx(30.0 * 3.0)
    middle = model.mesh.nodes[model.mesh.elements[shown]].mean(axis=1)[:, :2]
    assert np.column_stack([x.mean(axis=1), y.mean(axis=1)]) == pytest.approx(middle)
    if section == "solid":
        assert not model.mesh.nodes[outlines, 2].any()


@pytest.mark.parametrize(("specimen", "tip_deg"), [(planar("type1"), 52.4), (load_specimen("type1"), 57.7)])
def test_the_files_of_a_simulation_agree_with_each_other(
    tmp_path: Path, specimen: SpecimenFile, tip_deg: float
) -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    write_simulation(tmp_path, simulate(specimen, law, values, np.array([0.0, 3.5, 7.05]), 0.0))
    tip = np.genfromtxt(tmp_path / "tip.csv", delimiter=",", names=True)
    assert tip["angle_deg"][-1] == pytest.approx(tip_deg, abs=0.2)
    assert tip["x_mm"][0] == pytest.approx(30.0, abs=0.1)
    left = np.loadtxt(tmp_path / "state_02_left.csv", delimiter=",", skiprows=1)
    right = np.loadtxt(tmp_path / "state_02_right.csv", delimiter=",", skiprows=1)
    assert (left[0], right[0]) == (pytest.approx([0.0, -1.5], abs=1e-3), pytest.approx([0.0, 1.5], abs=1e-3))
    assert 0.5 * (left[-1] + right[-1]) == pytest.approx([tip["x_mm"][-1], tip["y_mm"][-1]], abs=5e-3)
    vtu = meshio.read(tmp_path / "state_02.vtu")
    place = vtu.points + vtu.point_data["displacement_mm"]
    (cells,) = vtu.cells
    # The displaced corners in order around each cell: the area of every cell stays nearly constant (incompressibility).
    corners = place[cells.data[:, : 4 if cells.type == "quad9" else 8]]
    if cells.type == "quad9":
        x, y = corners[..., 0], corners[..., 1]
        size, whole = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1), 26 * 3
    else:
        along, across, deep = (corners[:, i] - corners[:, 0] for i in (1, 3, 4))
        size, whole = np.einsum("ei,ei->e", np.cross(along, across), deep), 30 * 3 * 5 - 4 * 3 * 2
        rest = vtu.points[cells.data]  # nodes on the sides and in the middle lie between their corners
        assert rest[:, 8] == pytest.approx(0.5 * (rest[:, 0] + rest[:, 1]))
        assert rest[:, 19] == pytest.approx(0.5 * (rest[:, 3] + rest[:, 7]))
        assert rest[:, 23] == pytest.approx(rest[:, [2, 3, 6, 7]].mean(axis=1))
        assert vtu.points[:, 2].min() == -2.5
    assert size.sum() == pytest.approx(whole, rel=0.02)
    assert np.all(size > 0)
    assert vtu.cell_data["largest_stretch"][0].max() == pytest.approx(tip["max_stretch"][-1], abs=1e-5)
    assert (tmp_path / "shapes.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("model", "parameters", "expected"),
    [
        ("hooke", ["mu_Pa=1"], "--model hooke: there is no law 'hooke'; did you mean 'neo-hookean'?"),
        ("neo-hookean", ["mu=1"], "has the parameters mu_Pa, each of which should be given once; given are mu=1"),
        ("neo-hookean", ["mu_Pa=soft"], "--parameter mu_Pa=soft: should be KEY=NUMBER"),
        ("neo-hookean", ["mu_Pa=nan"], "--parameter mu_Pa=nan: should be KEY=NUMBER"),
        (
            "yeoh",
            ["C10_Pa=1", "C10_Pa=1", "C30_Pa=1"],
            "has the parameters C10_Pa, C20_Pa, C30_Pa, each of which should be given once",
        ),
    ],
)
def test_wrong_parameters_are_refused_in_one_line(model: str, parameters: list[str], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_parameters(model, parameters)
    assert expected in str(caught.value)


def test_a_law_without_an_equilibrium_is_refused_with_the_state() -> None:
    law, values = parse_parameters("yeoh", ["C10_Pa=25000", "C20_Pa=-100000", "C30_Pa=0"])
    with pytest.raises(InputError, match=r"specimen type1: yeoh at .* mT: (unstable|diverged|out of iterations)"):
        simulate(planar("type1"), law, values, np.array([0.0, 3.5, 30.0]), 0.0)


MAGNETISED = """
[specimen]
name = "powder"
material = "Ecoflex 00-50 with 10 % NdFeB"
length_mm = 60.0
width_mm = 1.0
depth_mm = 5.0
density_kg_m3 = 1500.0
section = "plane-stress"
magnetisation_kA_per_m = [{magnetisation}, 0.0]
"""


def eimi_simulate(folder: Path, *further: str, **process: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "eimi_lab", "simulate", "protocol.toml", "--specimen", "specimen.toml"]
    command += ["--model", "neo-hookean", "--parameter", "mu_Pa=50000", "-o", "out", "--force", *further]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False, **process
    )


def test_a_law_with_a_negative_initial_modulus_is_refused_with_this_modulus() -> None:
    law, values = parse_parameters("mooney-rivlin", ["C10_Pa=1000", "C01_Pa=-3000"])
    with pytest.raises(InputError, match="--parameter: the initial shear modulus of mooney-rivlin is -4000 Pa"):
        simulate(load_specimen("type1"), law, values, np.zeros(1), 0.0)


def test_a_full_disk_gives_an_error_and_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "specimen.toml").write_text(planar("type1").text)
    (tmp_path / "protocol.toml").write_text(load_protocol("dragon_skin_10_quick").text)
    for size, stops in ((64, "tip.csv"), (5000, "state_00.vtu")):  # largest size of every file, to imitate a full disk
        limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (size, size))
        done = eimi_simulate(tmp_path, preexec_fn=limit)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1), stops
        assert f"File too large: 'out/{stops}'" in done.stderr
        assert sorted(path.name for path in tmp_path.iterdir()) == ["protocol.toml", "specimen.toml"]


def test_a_magnetised_beam_from_files_bends_as_the_hard_magnetic_elastica(tmp_path: Path) -> None:
    # q = M B A L²/EI: the tip turns 26.4335 degrees at q = 1 and 44.7910 at 2 in a field across the beam. Gravity acts
    # along the beam and has no effect, because the density is nearly zero.
    bending = 3 * 50e3 * 1e-3**3 / 12  # bending stiffness in N m² for each metre of depth
    magnetisation = bending / (1e-3 * 60e-3**2 * 4.7e-3)  # magnetisation in A/m
    text = MAGNETISED.format(magnetisation=magnetisation / 1e3).replace("1500.0", "1e-3")
    (tmp_path / "specimen.toml").write_text(text)
    (tmp_path / "protocol.toml").write_text(load_protocol("dragon_skin_10").text)
    currents = np.array(load_protocol("dragon_skin_10").currents_A)
    done = eimi_simulate(tmp_path, "--coil-constant", f"{4.7 * 2 / currents.max():.6f}")
    assert done.returncode == 0, done.stderr
    tip = np.genfromtxt(tmp_path / "out" / "tip.csv", delimiter=",", names=True)
    assert tip["angle_deg"][-1] == pytest.approx(44.7910, rel=2e-3)
    # In the opposite direction, with a field rotated by 180 degrees.
    back = eimi_simulate(tmp_path, "--coil-constant", f"{4.7 * 2 / currents.max():.6f}", "--field-angle", "-90")
    assert back.returncode == 0, back.stderr
    mirrored = np.genfromtxt(tmp_path / "out" / "tip.csv", delimiter=",", names=True)
    assert mirrored["angle_deg"] == pytest.approx(-tip["angle_deg"], abs=1e-5)
    refused = eimi_simulate(tmp_path, "--bulk-modulus-kPa", "100")
    assert refused.returncode == 2
    assert "--bulk-modulus-kPa 100: plane stress is computed for incompressible materials only" in refused.stderr


def test_a_finite_bulk_modulus_bends_further() -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    field = np.array([0.0, 3.0])
    angles = []
    for bulk in (None, 1e6, 46.39, 1e12):
        simulation = simulate(planar("type1"), law, values, field, 0.0, bulk_modulus_kPa=bulk)
        angles.append(simulation.model.tip_angle_deg(simulation.shapes)[0, -1])
    assert angles[1] == pytest.approx(angles[0], rel=1e-3)
    assert angles[2] > 1.1 * angles[0]
    assert angles[3] == pytest.approx(angles[1], rel=1e-4)  # the limit for a large bulk modulus
    with pytest.raises(InputError, match="--bulk-modulus-kPa -1: should be greater than 0"):
        simulate(load_specimen("type1"), law, values, field, 0.0, bulk_modulus_kPa=-1.0)
    with pytest.raises(InputError, match=r"--bulk-modulus-kPa inf: should be .* omitted for an incompressible"):
        simulate(load_specimen("type1"), law, values, field, 0.0, bulk_modulus_kPa=np.inf)
    with pytest.raises(InputError, match="--field-angle nan: should be an angle in degrees, such as 90"):
        simulate(load_specimen("type1"), law, values, field, 0.0, np.nan)
    with pytest.raises(InputError, match="--coil-constant: the fields are not finite"):
        simulate(load_specimen("type1"), law, values, np.nan * field, 0.0)


def test_a_simulation_has_no_interval_if_too_many_draws_have_no_equilibrium() -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    simulation = simulate(planar("type1"), law, values, np.array([2.0]), 0.0, drawn=np.array([[45e3], [-5.0]]))
    assert simulation.tips is not None
    assert np.isnan(simulation.tips).all()
    assert simulation.remarks == (
        "no 95 % interval of the tip at 2 mT: up to 1 of 3 simulations with random parameters have no equilibrium",
    )
    without = simulate(planar("type1"), law, values, np.array([2.0]), 0.0, drawn=np.array([[-5.0]]))
    assert without.tips is not None
    assert np.isnan(without.tips).all()
