"""The error about a likely mistake in a file or an argument names the mistake and what would be right."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped

Run = Callable[..., tuple[int, str]]


def test_exchanged_arguments_for_a_dataset_and_a_fit_are_named(dataset: Path, tmp_path: Path, run: Run) -> None:
    fits = tmp_path / "fits.json"
    fits.write_text('{"fits": []}')
    status, message = run("report", fits, "--fit", dataset, "-o", tmp_path / "report.html")
    assert status == 2
    assert f"{dataset}: is a dataset" in message or f"{fits}: is a JSON file, not a dataset" in message
    assert "--fit" in message
    status, message = run("export", dataset, "--model", "yeoh", "--to", "abaqus")
    assert (status, message.count("\n")) == (2, 1)
    assert f"{dataset}: is a dataset, but a fits.json is needed here" in message
    with pytest.raises(InputError, match=r"is a dataset \(HDF5\), but a text file is needed here"):
        load_specimen(dataset)


@pytest.mark.parametrize("key", ["width_mm", "density_kg_m3"])
def test_a_decimal_comma_in_toml_is_named_with_its_line(files: Path, key: str) -> None:
    text = re.sub(rf"(?m)^{key} = .*$", f"{key} = 3,25   # as measured", (files / "specimen.toml").read_text())
    (files / "specimen.toml").write_text(text)
    line = 1 + [row.split(" ")[0] for row in text.splitlines()].index(key)
    with pytest.raises(InputError, match=rf"line {line}: {key} = 3,25 has a decimal comma; write 3\.25"):
        load_specimen(files / "specimen.toml")


@pytest.mark.parametrize(
    ("key", "value", "right"),
    [
        ("density_kg_m3", "1.07", "in g/cm3, write 1070"),
        ("width_mm", "0.003", "if the number is in metres, write 3"),
        ("length_mm", "0.06", "if the number is in metres, write 60"),
    ],
)
def test_the_error_for_a_value_in_another_unit_gives_the_right_value(
    files: Path, key: str, value: str, right: str
) -> None:
    file = files / "specimen.toml"
    file.write_text(re.sub(rf"(?m)^{key} = \S+", f"{key} = {value}", file.read_text()))
    with pytest.raises(InputError, match=rf"specimen\.{key} = {value} should be .*{right}"):
        load_specimen(file)


def test_a_tensile_table_with_decimal_commas_is_read(tmp_path: Path) -> None:
    rows = [(0.1 * k, 0.024 * k) for k in range(6)]
    german = "\n".join(["strain;stress_MPa", *(f"{e:.1f};{s:.3f}".replace(".", ",") for e, s in rows)])
    (tmp_path / "german.csv").write_text(german)
    (tmp_path / "points.csv").write_text("\n".join(["strain,stress_MPa", *(f"{e:.1f},{s:.3f}" for e, s in rows)]))
    one, other = read_tensile(tmp_path / "german.csv"), read_tensile(tmp_path / "points.csv")
    assert one.strain.tolist() == other.strain.tolist() == pytest.approx([e for e, _ in rows])
    assert one.stress_Pa.tolist() == other.stress_Pa.tolist()


def test_a_strain_in_per_cent_is_recognised(tmp_path: Path) -> None:
    file = tmp_path / "curve.csv"
    file.write_text("strain,stress_kPa\n" + "".join(f"{10 * k},{24 * k}\n" for k in range(6)))
    with pytest.raises(InputError, match=r"row 7: strain = '50' should be a fraction.*strain_percent"):
        read_tensile(file)
    file.write_text(file.read_text().replace("strain,", "strain_percent,"))
    assert read_tensile(file).strain.max() == pytest.approx(0.5)


def test_a_curve_of_a_few_per_cent_that_is_read_as_a_fraction_gets_a_hint(tmp_path: Path) -> None:
    file = tmp_path / "curve.csv"
    file.write_text("strain,stress_kPa\n" + "".join(f"{k},{2.4 * k:g}\n" for k in range(6)))  # per cent
    hint = r"1 row can be used.*the strains reach 500 %: name a column in per cent strain_percent"
    with pytest.raises(InputError, match=hint):
        fit_window(read_tensile(file), "neo-hookean", 20.0)


def test_decimal_commas_in_a_list_are_named(files: Path) -> None:
    file = files / "calibration.toml"
    file.write_text(re.sub(r"(?m)^clamp_midpoint_px = .*$", "clamp_midpoint_px = [640,5, 80,2]", file.read_text()))
    with pytest.raises(InputError, match=r"should have at most 2 values, not 4; decimals have a point, not a comma"):
        load_calibration(file)


@pytest.mark.parametrize("options", [(), ("--checkpoint", "fit.log")])
def test_ctrl_c_in_a_fit_prints_how_the_fit_can_be_continued(
    options: tuple[str, ...], dataset: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: Any, **options: Any) -> None:
        raise Stopped(signal.SIGINT)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eimi_lab.fits.fit_grid.fit_grid", interrupted)
    status, message = run("fit", dataset, "--model", "neo-hookean", "-o", "fits.json", *options)
    assert status == 130
    assert "stopped by SIGINT: " in message
    assert ("--resume continues the fit" if options else "a fit with --checkpoint FILE can be continued") in message


def test_the_output_of_a_dry_run_fits_on_a_screen_and_ends_with_the_duration(files: Path) -> None:
    protocol = files / "protocol.toml"
    protocol.write_text(protocol.read_text().replace("step_A = 0.1", "step_A = 0.01"))
    summary, whole = (printed(files, *options) for options in ((), ("-v",)))
    assert len(summary) <= 24
    assert summary[-1].startswith("duration: ")
    assert "… 23 states between …" in summary
    assert not any(" > " in line for line in summary)
    assert any("> ISET1:0.150" in line for line in whole)
    assert any(line.startswith("state 15: 0.15 A") for line in whole)
    assert whole[-1] == summary[-1]


def printed(folder: Path, *options: str) -> list[str]:
    command = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
    command += ["--rig", "virtual", "--dry-run", *options]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.splitlines()
