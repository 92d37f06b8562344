"""Small files that demand too much memory, processor time, depth of nesting or digits are refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import recovery
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.process import limits
from eimi_lab.process.errors import InputError
from eimi_lab.vision.image_files import read_image

Run = Callable[..., tuple[int, str]]
DEEP = 100_000


@pytest.fixture
def dataset(files: Path) -> Path:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    image = np.random.default_rng(0).integers(0, 255, (96, 128)).astype(np.uint8)
    with DatasetWriter(files / "run.h5", header, Frame(image, 0, 0.0)) as writer:
        for k in range(2):
            writer.append_state([Frame(image, k, 0.0)], current_A=k / 10, field_mT=k * 0.47)
    return files / "run.h5"


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * DEEP + "]" * DEEP,
        "a = " + "{b=" * DEEP + "1" + "}" * DEEP,
        "a" + ".a" * DEEP + " = 1",
        "[" + ".".join("a" * DEEP) + "]",
        "a = " + "9" * 5000,
        "a = 1e999",
    ],
)
def test_toml_of_any_depth_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "specimen.toml").write_text(text)
    with pytest.raises(InputError, match=r"specimen\.toml: ") as raised:
        load_specimen(tmp_path / "specimen.toml")
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 1000


@pytest.mark.parametrize(
    "text",
    [
        "[" * DEEP + "]" * DEEP,
        '{"a":' * DEEP,
        '{"fits": [' + "9" * 5000 + "]}",
        '{"fits": [NaN]}',
        '{"fits": 1e999}',
        "{",
    ],
)
def test_json_of_any_depth_and_length_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "fits.json").write_text(text)
    with pytest.raises(InputError, match=r"fits\.json: ") as raised:
        read_fits_file(tmp_path / "fits.json")
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 1000


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0.1,-1e308", "a stress of at most 1e+12 Pa"),
        ("1e9,1", "an engineering strain above -1 (-100 %) and at most 100"),
    ],
)
def test_absurd_tensile_rows_are_refused_in_one_line(run: Run, tmp_path: Path, row: str, words: str) -> None:
    rows = [f"{0.05 * k},{0.01 * k}" for k in range(8)]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_MPa", *rows, row]) + "\n")
    status, message = run("tensile", tmp_path / "curve.csv", "--model", "neo-hookean", "-o", tmp_path / "out.json")
    assert (status, message.count("\n")) == (2, 1), message
    assert words in message


def test_frames_that_unpack_to_more_than_a_quarter_of_the_free_memory_are_not_unpacked(dataset: Path) -> None:
    with h5py.File(dataset, "r+") as file:  # chunks that were never written occupy no space in the file
        data = file["entry/data"]
        rows = limits.free_memory_bytes() // data["frames"][0].nbytes
        for name in data:
            if isinstance(data[name], h5py.Dataset) and data[name].ndim and len(data[name]) == 2:
                data[name].resize(rows, axis=0)
    assert dataset.stat().st_size < 10_000_000
    with open_dataset(dataset) as opened, pytest.raises(InputError, match=r"would take .* GB of memory"):
        opened.images(0)


def test_an_image_that_needs_too_much_of_the_free_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "flat.png"), np.zeros((4000, 4000), np.uint8))
    assert read_image(tmp_path / "flat.png").shape == (4000, 4000)
    monkeypatch.setattr(limits, "free_memory_bytes", lambda: 64 << 20)
    with pytest.raises(InputError, match=r"flat\.png: an image of 4000 x 4000 px would take"):
        read_image(tmp_path / "flat.png")


def test_the_free_memory_comes_from_the_system_or_is_assumed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert 1 << 20 < limits.free_memory_bytes() < 1 << 50
    for source in ("_linux", "_windows", "_macos"):
        monkeypatch.setattr(limits, source, lambda: 0)
    monkeypatch.delattr("os.sysconf", raising=False)
    assert limits.free_memory_bytes() <= limits.ASSUMED_FREE_BYTES


def test_a_limit_of_memory_that_the_system_refuses_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    # macOS refuses every limit of the address space (python/cpython issue 78783).
    resource = pytest.importorskip("resource", reason="Windows has no limits of this kind")

    def refuse(which: int, limit: tuple[int, int]) -> None:
        raise ValueError("current limit exceeds maximum limit")

    monkeypatch.setattr(resource, "setrlimit", refuse)
    limits.limit_memory(1 << 40)


def test_a_slow_recovery_does_not_report_the_file_as_damaged(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("resource")
    (tmp_path / "site").mkdir()
    # `-m` runs the module under the name __main__, so that the test replaces a function that it imports.
    endless = (
        "import eimi_lab.dataset.repair.superblock as at\nat.close_superblock = lambda file: exec('while 1: pass')\n"
    )
    (tmp_path / "site" / "sitecustomize.py").write_text(endless)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.setattr(recovery, "READ_WITHIN_S", 5.0)
    with pytest.raises(InputError, match="took longer than 5 s of processor time") as raised:
        recovery.recover(dataset, tmp_path / "out.h5")
    assert "damaged" not in str(raised.value)


def test_a_sound_file_is_recovered_where_memory_is_limited_already(dataset: Path, tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    most = 3 << 30
    command = [sys.executable, "-m", "eimi_lab", "recover", str(dataset), "-o", str(tmp_path / "out.h5")]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )
    assert done.returncode == 0, done.stderr
    with open_dataset(tmp_path / "out.h5") as recovered:
        assert len(recovered.states) == 2


def test_a_c3d_file_that_crashes_its_reader_is_refused_in_one_line(
    run: Run, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "site").mkdir()
    crash = "import os, signal\ndef c3d(path):\n    os.kill(os.getpid(), signal.SIGSEGV)\n"
    (tmp_path / "site" / "ezc3d.py").write_text(crash)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.syspath_prepend(tmp_path / "site")
    (files / "capture.c3d").write_bytes(b"\2\x50" + bytes(1022))
    (files / "states.csv").write_text("frame,field_mT\n1,0\n2,1\n")
    options = ("--format", "c3d", "--states", files / "states.csv", "--specimen", files / "specimen.toml")
    status, message = run("import", files / "capture.c3d", *options, "-o", files / "out.h5")
    assert (status, message.count("\n")) == (2, 1), message
    assert "capture.c3d: is damaged: the process that read this file crashed (signal SIGSEGV)" in message
