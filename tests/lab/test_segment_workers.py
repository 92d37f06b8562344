"""`eimi segment --workers`: several processes give the same result as one process, and end with the program."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.patience import PATIENCE_S

Run = Callable[..., tuple[int, str]]

pytestmark = pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="more workers than processors are not begun")


def imported(run: Run, files: Path, images: list[NDArray[np.uint8]]) -> Path:
    folder = files / "frames"
    folder.mkdir()
    lines = ["frame,current_A"]
    for index, image in enumerate(images):
        cv2.imwrite(str(folder / f"{index:03d}.png"), image)
        lines.append(f"{index:03d}.png,{index / 1000}")
    (files / "states.csv").write_text("\n".join(lines) + "\n")
    given = ["--states", files / "states.csv", "--specimen", files / "specimen.toml"]
    status, message = run("import", folder, *given, "--calibration", files / "calibration.toml", "-o", files / "run.h5")
    assert status == 0, message
    return files / "run.h5"


def content(path: Path) -> dict[str, bytes]:
    # Return the bytes of each array of a dataset, by name.
    arrays: dict[str, bytes] = {}

    def keep(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and name != "entry/segmentation/date":
            arrays[name] = np.asarray(item[()]).tobytes()

    with h5py.File(path, "r") as file:
        file.visititems(keep)
    assert "entry/segmentation/edges/left/points" in arrays
    return arrays


def test_two_workers_give_the_same_dataset_as_one(
    run: Run, files: Path, frame: Callable[..., NDArray[np.uint8]]
) -> None:
    # The frames are corrected by a flat field (an image of the uneven light), and one state shows no beam.
    images = [frame(seed, seed / 2) for seed in range(6)]
    images[3] = np.full_like(images[3], 200)
    one, two = imported(run, files, images), files / "two.h5"
    cv2.imwrite(str(files / "flat.png"), np.tile(np.linspace(150, 250, 128).astype(np.uint8), (96, 1)))
    assert run("segment", one, "--flat", files / "flat.png")[0] == 0  # the dataset stores the flat field
    shutil.copy(one, two)
    messages = []
    for path, workers in ((one, 1), (two, 2)):
        status, message = run("segment", path, "--workers", workers)
        assert status == 0, message
        messages.append([line.split(", about ")[0] for line in message.splitlines() if line.startswith("segment ")])
    assert messages[0] == messages[1]
    assert [line.split(":")[0] for line in messages[1]] == [f"segment {number}/6" for number in range(1, 7)]
    assert content(one) == content(two)


def test_an_error_of_a_worker_is_reported_as_with_one_process(
    run: Run, files: Path, frame: Callable[..., NDArray[np.uint8]]
) -> None:
    path = imported(run, files, [frame(seed) for seed in range(4)])
    with h5py.File(path, "r") as file:
        chunk = file["entry/data/frames"].id.get_chunk_info(2)
    with path.open("r+b") as file:
        file.seek(chunk.byte_offset)
        file.write(bytes(chunk.size))
    messages = [run("segment", path, "--workers", workers) for workers in (1, 2)]
    assert messages[0][0] == messages[1][0] == 2
    assert "frames of state 2 (counted from 0) is damaged" in messages[0][1]
    assert messages[0][1].splitlines()[-1] == messages[1][1].splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_to_all_workers_ends_all_of_them_with_one_line(
    run: Run, files: Path, frame: Callable[..., NDArray[np.uint8]], number: signal.Signals
) -> None:
    # A terminal sends Ctrl-C to all processes at once; when it is closed, it sends the hang-up signal.
    path = imported(run, files, [frame(seed) for seed in range(20)] * 10)
    before = path.read_bytes()
    process = subprocess.Popen(
        [sys.executable, "-m", "eimi_lab", "segment", str(path), "--workers", "2"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(
            number, signal.SIG_DFL
        ),  # a test that runs in the background ignores this signal
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("segment 1/200: ")
    os.killpg(process.pid, number)
    lines = process.communicate(timeout=PATIENCE_S)[1].splitlines()  # reads until the last process has ended
    assert process.returncode == 128 + number
    assert lines[-1] == f"eimi: stopped by {number.name}"
    assert [line for line in lines[:-1] if not line.startswith("segment ")] == []
    assert path.read_bytes() == before
