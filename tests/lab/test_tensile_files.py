"""Tensile tests in two file formats are fitted and become material cards; a faulty file gives an error of one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.laws.cards import SOLVERS
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.process.errors import InputError

Run = Callable[..., tuple[int, str]]

STRAIN = np.linspace(0.05, 1.2, 24)
STRESS_KPA = 46 * (1 + STRAIN - (1 + STRAIN) ** -2)
DATABASE = "PARAMETER;INFO;URL;;\nSpecimen Width (mm);6;;;\nMaterial;Silicone 10;;;\n;;;;\n"
COLUMNS = "Time (s);True Strain;True Stress (MPa);Engineering Strain;Engineering Stress (MPa)\n"


def plain(path: Path, header: str = "strain,stress_kPa", factor: float = 1.0, strain_factor: float = 1.0) -> Path:
    rows = (f"{strain_factor * e},{factor * s}" for e, s in zip(STRAIN, STRESS_KPA, strict=True))
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.fixture
def curve(tmp_path: Path) -> Path:
    return plain(tmp_path / "curve.csv")


@pytest.mark.parametrize(
    ("header", "factor", "strain_factor"),
    [
        ("strain,stress_kPa", 1.0, 1.0),
        ("strain,stress_MPa", 1e-3, 1.0),
        ("strain_percent,stress_Pa", 1e3, 100.0),
    ],
)
def test_the_units_of_plain_columns_are_in_their_names(
    tmp_path: Path, header: str, factor: float, strain_factor: float
) -> None:
    test = read_tensile(plain(tmp_path / "curve.csv", header, factor, strain_factor))
    assert test.strain == pytest.approx(STRAIN)
    assert test.stress_Pa == pytest.approx(1e3 * STRESS_KPA)
    assert test.material is None


def test_a_file_in_the_format_of_the_database_is_read(tmp_path: Path) -> None:
    rows = "".join(f"0.1;9;9;{e};{1e-3 * s}\n" for e, s in zip(STRAIN, STRESS_KPA, strict=True))
    (tmp_path / "test.csv").write_text(DATABASE + COLUMNS + rows)
    test = read_tensile(tmp_path / "test.csv")
    assert test.strain == pytest.approx(STRAIN)
    assert test.stress_Pa == pytest.approx(1e3 * STRESS_KPA)
    assert test.material == "Silicone 10"


def test_files_of_the_database_are_read(measured: Path) -> None:
    dragon, ecoflex = (
        read_tensile(measured / "tensile" / f"{n}.csv") for n in ("dragon_skin_10_medium", "ecoflex_00-50")
    )
    assert (dragon.material, len(dragon.strain)) == ("DragonSkin10", 457)
    assert (ecoflex.material, len(ecoflex.strain), ecoflex.stress_Pa[0]) == ("EcoFlex50", 721, -940.0)
    assert dragon.stress_Pa[-1] == pytest.approx(1843791.3, abs=1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "curve.csv: row 1: '' should have one of strain, strain_percent and one of stress_Pa"),
        ("strain,stress\n0.1,2\n", "row 1: 'strain,stress' should have one of strain, strain_percent and one of"),
        ("strain,stress_kPa,stress_MPa\n0.1,2,3\n", "and one of stress_Pa, stress_kPa, stress_MPa"),
        ("strain,stress_kPa,time\n0.1,2,3\n", "row 1: 'time' is not a known column"),
        ("strain,stress_kPa\n0.1,2\n0.2,x\n", "row 3: stress_kPa = 'x' should be a number"),
        ("strain,stress_kPa\n0.1,2\n0.2,nan\n", "row 3: stress_kPa = 'nan' should be a finite number"),
        ("strain_percent,stress_kPa\n-100,2\n", "row 2: strain_percent = '-100' should be an engineering strain above"),
        ("strain,stress_kPa\n0.1\n", "row 2: has 1 cells, but the header has 2 columns"),
        ("strain,stress_kPa\n0.1,2\n0.2,3\n", "2 rows can be used, but a fit of the mooney-rivlin law"),
        (DATABASE, "has no header with the columns Engineering Strain and Engineering Stress (MPa)"),
        (DATABASE + COLUMNS, "has a header but no rows"),
        (DATABASE + COLUMNS + "1;2;3;0.1\n", "row 6: has 4 cells; the header has 5 columns"),
        (DATABASE + COLUMNS + "1;2;3;0,1,2;4\n", "row 6: Engineering Strain = '0,1,2' should be a number"),
    ],
)  # fmt: skip
def test_an_error_in_a_file_is_reported_in_one_line(run: Run, tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "curve.csv").write_text(text)
    status, message = run("tensile", tmp_path / "curve.csv", "--model", "mooney-rivlin", "--window", "full",
                       "-o", tmp_path / "fits.json")  # fmt: skip
    assert (status, message.count("\n")) == (2, 1)
    assert expected in message
    assert not (tmp_path / "fits.json").exists()


@settings(max_examples=50)
@given(st.text(alphabet="strain,_percentkPM;\n0123456789.-eE", max_size=80))
def test_any_text_is_read_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text(text)
    try:
        test = read_tensile(path)
    except InputError:
        return
    assert len(test.strain) == len(test.stress_Pa) > 0
    assert np.isfinite([test.strain, test.stress_Pa]).all()


def test_a_compression_test_is_fitted_in_its_window(run: Run, tmp_path: Path) -> None:
    strain = np.linspace(-0.02, -0.6, 30)
    stress_kPa = 46 * (1 + strain - (1 + strain) ** -2)
    rows = (f"{e},{s}" for e, s in zip(strain, stress_kPa, strict=True))
    (tmp_path / "pressed.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    output = tmp_path / "fits.json"
    arguments = ("--model", "neo-hookean", "--window", "21", "--window", "full", "-o", output)
    assert run("tensile", tmp_path / "pressed.csv", *arguments)[0] == 0
    fits = json.loads(output.read_text())["fits"]
    assert [fit["rows"] for fit in fits] == [10, 30]
    assert [fit["max_stretch"] for fit in fits] == pytest.approx([0.8**-0.5, 0.4**-0.5])


def test_a_negative_initial_modulus_is_a_result_but_cannot_be_a_card(run: Run, tmp_path: Path) -> None:
    # A Mooney-Rivlin fit to a stiffening curve may have a negative modulus, which no solver accepts.
    strain = np.linspace(0.2, 7.0, 60)
    rows = (f"{e},{46 * e + 2 * e**3}" for e in strain)
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    output = tmp_path / "fits.json"
    given = ("tensile", tmp_path / "curve.csv", "--model", "mooney-rivlin", "--window", "full", "-o", output)
    assert run(*given) == (0, "")
    [fit] = read_fits_file(output).fits
    assert fit.initial_shear_modulus.value < 0
    (written,) = json.loads(output.read_text())["fits"]
    words = [doubt["words"] for doubt in written["doubts"]]
    assert any("initial shear modulus reaches zero" in doubt for doubt in words)
    assert any("not Drucker-stable" in doubt for doubt in words)
    status, message = run("export", output, "--model", "mooney-rivlin", "--to", "abaqus", "--bulk-ratio", "2000")
    assert (status, message.count("\n")) == (2, 1)
    assert "a finite-element program needs a positive value" in message


def test_fits_of_windows_are_written_and_read(run: Run, curve: Path) -> None:
    output = curve.with_name("fits.json")
    status, message = run("tensile", curve, "--model", "neo-hookean", "--model", "ogden", "--window", "50", "--window",
                       "full", "--relative", "-o", output)  # fmt: skip
    assert (status, message) == (0, "")
    fits = read_fits_file(output).fits
    assert [(f.model, f.window()) for f in fits if isinstance(f, TensileRecord)] == [
        ("neo-hookean", "50 %"), ("ogden", "50 %"), ("neo-hookean", "full"), ("ogden", "full")
    ]  # fmt: skip
    for fit in fits:
        assert isinstance(fit, TensileRecord)
        assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)
        assert fit.max_stretch == pytest.approx(1.5 if fit.window_percent else 2.2)
        assert (fit.residuals, fit.source.path) == ("relative", str(curve))
        for quantity in (*fit.parameters.values(), fit.initial_shear_modulus):
            low, high = quantity.interval_95
            assert low <= quantity.value <= high
    # Files of an earlier release contain no correlation.
    written = json.loads(output.read_text())
    for fit in written["fits"]:
        del fit["correlation"]
    output.write_text(json.dumps(written))
    assert [fit.values() for fit in read_fits_file(output).fits] == [fit.values() for fit in fits]


def test_parameters_of_another_law_are_refused(run: Run, curve: Path) -> None:
    output = curve.with_name("fits.json")
    assert run("tensile", curve, "--model", "yeoh", "--window", "full", "-o", output)[0] == 0
    content = json.loads(output.read_text())
    content["fits"][0]["model"] = "mooney-rivlin"
    output.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"fits\.0: .*parameters of mooney-rivlin should be C10, C01"):
        read_fits_file(output)


@pytest.mark.parametrize("window", ["0", "-5", "inf", "nan", "wide"])
def test_a_wrong_window_is_refused(run: Run, curve: Path, window: str) -> None:
    status, message = run("tensile", curve, "--model", "yeoh", f"--window={window}", "-o", curve.with_name("f.json"))
    assert (status, message.count("\n")) == (2, 1)
    assert f"--window {window}: should be a strain in percent above 0, or full" in message


@pytest.fixture
def fits(run: Run, curve: Path) -> Path:
    # The results file with one neo-Hookean fit and two Yeoh fits of a tensile curve.
    output = curve.with_name("fits.json")
    assert run("tensile", curve, "--model", "yeoh", "--window", "50", "--window", "full", "-o", output)[0] == 0
    nh = curve.with_name("nh.json")
    assert run("tensile", curve, "--model", "neo-hookean", "--window", "full", "-o", nh)[0] == 0
    both = [fit for file in (output, nh) for fit in json.loads(file.read_text())["fits"]]
    output.write_text(json.dumps({"fits": both}))
    return output


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_card_names_its_source(run: Run, fits: Path, solver: str) -> None:
    card = fits.with_name("card.txt")
    status, message = run("export", fits, "--model", "neo-hookean", "--to", solver, "--bulk-ratio", "2000", "-o", card)
    assert status == 0
    assert all(line.startswith(f"eimi: {fits}: neo-hookean: ") for line in message.splitlines())
    text = card.read_text()
    for words in (
        *(line.removeprefix(f"eimi: {fits}: neo-hookean: ") for line in message.splitlines()),
        "curve.csv",
        "sha256",
        "window full",
        "largest principal stretch of 2.2",
        "fits.json",
        "chosen for this card",
    ):
        assert words in text


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("yeoh abaqus --bulk-ratio 9", "holds 2 fits of the law yeoh; give one of --index 0 (yeoh, window 50 %)"),
        ("yeoh abaqus --index 2 --bulk-ratio 9", "--index 2: should be the index of a yeoh fit"),
        ("ogden abaqus --bulk-ratio 9", "--model ogden: should be one of the file's fits"),
        ("hooke abaqus --bulk-ratio 9", "--model hooke: there is no law 'hooke'; did you mean 'neo-hookean'?"),
        ("neo-hookean nastran --bulk-ratio 9", "--to nastran: should be one of abaqus"),
        ("neo-hookean ansys", "give either --bulk-modulus-kPa or --bulk-ratio"),
        ("neo-hookean ansys --bulk-ratio 9 --bulk-modulus-kPa 9", "give either --bulk-modulus-kPa or --bulk-ratio"),
        ("neo-hookean ansys --bulk-ratio 0", "--bulk-ratio 0.0: should be a finite number"),
        ("neo-hookean ansys --bulk-modulus-kPa 9", "should be above two thirds"),
        ("yeoh sofa --index 1 --bulk-ratio 9", "sofa has no yeoh law"),
    ],
)
def test_an_impossible_export_is_refused_in_one_line(run: Run, fits: Path, arguments: str, expected: str) -> None:
    card = fits.with_name("card.txt")
    model, solver, *others = arguments.split()
    status, message = run("export", fits, "--model", model, "--to", solver, *others, "-o", card)
    assert (status, message.count("\n")) == (2, 1)
    assert expected in message
    assert not card.exists()
