"""A field that is added to FitOptions becomes an option of `eimi fit`, and reaches checkpoint and fit."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from eimi_lab.commands.material_laws import fit
from eimi_lab.commands.shared_options import Output, with_fields
from eimi_lab.fits.options import FitOptions
from eimi_lab.process.errors import InputError


@dataclass(frozen=True)
class MoreOptions(FitOptions):
    population: Annotated[int, typer.Option(help="of the search", min=2)] = 8


received: list[MoreOptions] = []


@with_fields(MoreOptions)
def command(output: Output, options: MoreOptions, again: bool = False) -> None:
    # A replacement for `eimi fit`, which records its options.
    received.append(options)


def test_each_field_is_an_option_of_the_command_and_a_key_of_the_checkpoint() -> None:
    names = {field.name for field in fields(FitOptions)}
    assert names <= set(inspect.signature(fit).parameters)
    assert names == set(FitOptions().head())


def test_options_of_the_command_line_set_the_fields_and_wrong_values_are_refused() -> None:
    received.clear()
    app = typer.Typer()
    app.command()(command)
    result = CliRunner().invoke(app, ["-o", "fits.json", "--population", "12", "--bipop"])
    assert result.exit_code == 0, result.output
    assert received == [MoreOptions(population=12, bipop=True)]
    assert received[0].head()["population"] == 12
    assert CliRunner().invoke(app, ["-o", "fits.json", "--population", "1"]).exit_code == 2


def test_an_unknown_nuisance_is_refused_with_a_list_of_all() -> None:
    with pytest.raises(InputError) as raised:
        FitOptions(free=["widht=0.1"]).for_identify()
    for words in ("moment=0.02 (relative)", "coil=0.01 (relative)", "roll=0.1 (degrees)", "clamp=0.05 (mm)", "bulk"):
        assert words in str(raised.value)


def test_curves_are_checked_before_the_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--tensile-window 20: needs a tensile curve"):
        FitOptions(tensile_window="20").for_identify()
    (tmp_path / "short.csv").write_text("strain,stress_kPa\n0.1,5\n0.2,9\n")
    with pytest.raises(InputError, match="2 rows up to the largest strain to fit"):
        FitOptions(tensile=[tmp_path / "short.csv"]).for_identify()


def test_a_prior_reaches_the_fit_and_a_wrong_one_is_refused_with_the_right_form() -> None:
    options = FitOptions(prior=["C10=20000,500"])
    (prior,) = options.for_identify()["priors"]
    assert (prior.parameter, prior.mean, prior.standard_deviation) == ("C10", 20e3, 500.0)
    options.check_laws(["yeoh"])
    with pytest.raises(InputError, match="--prior: ogden has no parameter 'C10'; there are mu1, alpha1"):
        options.check_laws(["yeoh", "ogden"])
    with pytest.raises(InputError, match="did you mean 'C10'"):
        FitOptions(prior=["c10=20000,500"]).check_laws(["yeoh"])
    for words in ("C10", "C10=20000", "C10=20000,five", "C10=1,2,3"):
        with pytest.raises(InputError, match=f"--prior {words}: should be PARAMETER=MEAN,DEVIATION"):
            FitOptions(prior=[words]).for_identify()
    with pytest.raises(InputError, match=r"--prior C10=20000,0: .*should be a number above 0"):
        FitOptions(prior=["C10=20000,0"]).for_identify()
