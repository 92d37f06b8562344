"""The specimen and the calibration of a dataset can be corrected after the run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_fitting.time.measured import Motion
from eimi_lab.dataset.moving.motion_import import add_motions
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.restating import restate
from eimi_lab.fits.fits_file import read_fits_file

Run = Callable[..., tuple[int, str]]
PROTOCOLS = Path(__file__).parents[2] / "protocols"


def changed(file: Path, key: str, value: object) -> Path:
    # Write a copy of a TOML file with another value of one key, beside the file; return the path of the copy.
    lines = [f"{key} = {value}" if line.startswith(f"{key} = ") else line for line in file.read_text().splitlines()]
    beside = file.with_name(f"other_{file.name}")
    beside.write_text("\n".join(lines) + "\n")
    return beside


@pytest.fixture
def acquired(setup) -> Path:
    # A dataset of four states from an emulated bench.
    setup.run()
    return setup.path


def test_new_files_replace_the_stored_files_and_the_old_files_are_kept(
    run: Run, acquired: Path, files: Path, capsys
) -> None:
    assert run("segment", acquired)[0] == 0
    with open_dataset(acquired) as dataset:
        before = dataset.text("calibration"), dataset.text("specimen")
        places_mm = (dataset.edges() or ())[0].left.points_mm
    calibration = changed(files / "calibration.toml", "pixels_per_mm", 8.4)
    specimen = changed(files / "specimen.toml", "width_mm", 1.9)
    assert run("segment", acquired, "--calibration", calibration, "--specimen", specimen)[0] == 0
    with open_dataset(acquired) as dataset:
        assert dataset.calibration is not None
        assert (dataset.calibration.pixels_per_mm, dataset.specimen.specimen.width_mm) == (8.4, 1.9)
        assert dataset.text("calibration") == calibration.read_text()
        assert (dataset.edges() or ())[0].left.points_mm[:, 1].mean() / places_mm[:, 1].mean() == pytest.approx(
            8.0 / 8.4, rel=0.01
        )
        corrections = dataset.corrections()
    assert sorted(line.partition(":")[2] for line in corrections) == [
        " pixels_per_mm was 8.0, and is 8.4 now",
        " specimen.width_mm was 2.0, and is 1.9 now",
    ]
    with h5py.File(acquired) as file:
        kept = [bytes(file[f"entry/former/{name}_0/data"][()]).decode() for name in ("calibration", "specimen")]
    assert tuple(kept) == before
    # After a second correction and a recovery, all former files are kept in their order.
    assert run("segment", acquired, "--axis", "89.5")[0] == 0
    recover(acquired, files / "again.h5")
    with open_dataset(files / "again.h5") as dataset:
        words = [line.partition(": ")[2] for line in dataset.corrections() if line.startswith("calibration")]
    assert words == ["pixels_per_mm was 8.0, and is 8.4 now", "axis_angle_deg was 90.0, and is 89.5 now"]


def test_changed_values_are_printed_and_equal_files_change_nothing(
    run: Run, acquired: Path, files: Path, monkeypatch
) -> None:
    messages: list[object] = []
    monkeypatch.setattr("builtins.print", lambda *lines, **_: messages.extend(lines))
    calibration = changed(files / "calibration.toml", "gravity_angle_deg", -90.0)
    assert run("segment", acquired, "--calibration", calibration)[0] == 0
    assert "calibration: gravity_angle_deg was 90.0, and is -90.0 now" in messages
    assert run("segment", acquired, "--calibration", calibration)[0] == 0
    assert any("nothing changed, because the dataset has these values already" in str(line) for line in messages)
    with open_dataset(acquired) as dataset:
        assert len(dataset.corrections()) == 1


def test_the_fields_of_a_run_follow_its_coil_constant(run: Run, acquired: Path, files: Path) -> None:
    with open_dataset(acquired) as dataset:
        before = np.array([state.field_mT for state in dataset.states])
    calibration = changed(files / "calibration.toml", "coil_constant_mT_per_A", 9.4)
    assert run("segment", acquired, "--calibration", calibration)[0] == 0
    with open_dataset(acquired) as dataset:
        assert [state.field_mT for state in dataset.states] == pytest.approx(2 * before)
    with h5py.File(acquired) as file:
        assert file["entry/data/field"][()].max() == pytest.approx(2 * before.max())


def test_a_calibration_without_the_coil_constant_of_the_run_is_refused(run: Run, acquired: Path, files: Path) -> None:
    before = acquired.read_bytes()
    lines = [line for line in (files / "calibration.toml").read_text().splitlines() if "coil" not in line]
    (files / "corrected.toml").write_text("\n".join(lines))
    status, message = run("segment", acquired, "--calibration", files / "corrected.toml")
    assert status == 2
    assert "corrected.toml: coil_constant_mT_per_A is missing; the run used 4.7" in message
    assert acquired.read_bytes() == before


def test_a_correction_restores_fields_that_do_not_follow_from_the_currents(
    run: Run, acquired: Path, files: Path
) -> None:
    with h5py.File(acquired, "r+") as file:  # an earlier release stored zeros if the coil constant was left out
        file["entry/states/field"][...] = file["entry/data/field"][...] = 0.0
    calibration = changed(files / "calibration.toml", "gravity_angle_deg", 91.0)
    assert run("segment", acquired, "--calibration", calibration)[0] == 0
    with open_dataset(acquired) as dataset:
        assert [state.field_mT for state in dataset.states] == pytest.approx([0.0, 0.47, 0.94, 1.41])
    with h5py.File(acquired) as file:
        assert file["entry/data/field"][()].max() == pytest.approx(1.41)


def test_files_of_another_specimen_or_coil_are_refused_with_the_key(
    run: Run, dataset: Path, pictures: Path, files: Path
) -> None:
    before = dataset.read_bytes()
    status, message = run("segment", dataset, "--specimen", changed(files / "specimen.toml", "name", '"large"'))
    assert status == 2
    assert "specimen.name = 'large', but" in message
    assert "it should have specimen.name = 'small'" in message
    # Fields of imported pictures may not follow from currents.
    status, message = run(
        "segment", dataset, "--calibration", changed(files / "calibration.toml", "coil_constant_mT_per_A", 9.4)
    )
    assert status == 2
    assert "coil_constant_mT_per_A = 9.4, but" in message
    assert "so repeat the import" in message
    assert dataset.read_bytes() == before


def test_positions_that_a_new_calibration_does_not_contain_keep_their_values(
    run: Run, dataset: Path, files: Path
) -> None:
    lines = [line for line in (files / "calibration.toml").read_text().splitlines() if "clamp" not in line]
    (files / "corrected.toml").write_text("\n".join(lines).replace("8.0", "8.1"))
    assert run("segment", dataset, "--calibration", files / "corrected.toml")[0] == 0
    with open_dataset(dataset) as opened:
        assert opened.calibration is not None
        assert (opened.calibration.pixels_per_mm, opened.calibration.clamp_midpoint_px) == (8.1, (64.0, 8.0))


def test_motions_measured_with_the_former_calibration_are_removed(
    dataset: Path, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest_mm = np.array([[5.0, 0.0], [10.0, 0.0]])
    creep = Motion(
        kind="creep",
        points_mm=np.repeat(rest_mm[None], 4, axis=0),
        rest_mm=rest_mm,
        time_s=np.repeat(np.arange(1.0, 5.0)[:, None], 2, axis=1),
        sigma_mm=np.full((4, 2), 0.01),
    )
    with open_dataset(dataset) as opened:
        specimen = opened.specimen
    add_motions(dataset, [creep], specimen)
    restate(dataset, changes={"pixels_per_mm": 8.0})  # no change
    # The points stay in place: the density has another value, and the calibration only a comment more.
    (files / "commented.toml").write_text("# May\n" + (files / "calibration.toml").read_text())
    denser = str(changed(files / "specimen.toml", "density_kg_m3", 1081.0))
    restate(dataset, specimen=denser, calibration=files / "commented.toml")
    with open_dataset(dataset) as opened:
        assert (opened.specimen.specimen.density_kg_m3, len(opened.creeps())) == (1081.0, 1)
    assert not capsys.readouterr().err
    restate(dataset, changes={"pixels_per_mm": 8.4})
    assert "run.h5: the imported creep is older than this correction and was removed" in capsys.readouterr().err
    with open_dataset(dataset) as opened:
        assert opened.creeps() == ()


@pytest.mark.slow
def test_a_wrong_width_is_named_corrected_and_fitted(run: Run, tmp_path: Path) -> None:
    data, fits = tmp_path / "run.h5", tmp_path / "fits.json"
    assert run("acquire", "dragon_skin_10_quick", "--specimen", "type1", "--rig", "virtual", "-o", data)[0] == 0
    text = (PROTOCOLS / "specimens" / "type1.toml").read_text(encoding="utf-8")
    (tmp_path / "specimen.toml").write_text(text.replace("width_mm = 3.0 ", "width_mm = 6.0 ", 1))
    assert run("segment", data, "--specimen", tmp_path / "specimen.toml")[0] == 0
    fit = ("fit", data, "--model", "neo-hookean", "--section", "plane-stress", "-o", fits, "--force")
    status, message = run(*fit)
    assert status == 2
    assert "the beam in the picture is 0.5 times as wide as the specimen file says" in message
    assert f"eimi segment {data} --specimen specimen.toml" in message
    (tmp_path / "specimen.toml").write_text(text)
    assert run("segment", data, "--specimen", tmp_path / "specimen.toml")[0] == 0
    assert run(*fit)[0] == 0
    (fitted_law,) = read_fits_file(fits).fits
    assert fitted_law.initial_shear_modulus.value == pytest.approx(46390, rel=0.06)  # plane stress is an approximation
