"""Only one program at a time writes to a file; a file may be moved or deleted while it is written."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.repair import probing
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.fits.checkpoint import Checkpoint, Head
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file, whole_folder
from eimi_lab.process.writer_lock import WriterLock, is_being_written, lock_file, only_writer
from tests.patience import PATIENCE_S

# A run that stores a state for each line that it reads, and prints the number of the state; the test ends this run.
WRITER = """
import sys
from pathlib import Path
import numpy as np
from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.writing import DatasetWriter

path = Path(sys.argv[1])
header = Header(load_specimen(path.parent / "specimen.toml"), load_calibration(path.parent / "calibration.toml"))
frame = lambda k: Frame(np.random.default_rng(k).integers(0, 255, (96, 128)).astype(np.uint8), k, 0.0)
with DatasetWriter(path, header, frame(0)) as writer:
    for k, line in enumerate(sys.stdin):
        writer.append_state([frame(k)], current_A=k / 10, field_mT=k * 0.47)
        print(k, flush=True)
"""


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (96, 128)).astype(np.uint8)


@contextmanager
def writing(path: Path, states: int) -> Iterator[subprocess.Popen[str]]:
    # Start a process that stores `states` states in a dataset, and one more for each line on its input.
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        for _ in range(states):
            store(process)
        yield process
        assert process.stdin is not None
        process.stdin.close()
        process.wait(PATIENCE_S)


def store(process: subprocess.Popen[str]) -> int:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return int(process.stdout.readline())


def assert_whole(path: Path, states: int) -> None:
    with open_dataset(path) as dataset:
        assert dataset.finished
        assert len(dataset.states) == states
        for k in range(states):
            assert np.array_equal(dataset.images(k)[0], image(k))


def test_a_file_in_use_cannot_be_replaced_recovered_or_segmented(
    files: Path, run: Callable[..., tuple[int, str]]
) -> None:
    path = files / "run.h5"
    rig = ("--specimen", files / "specimen.toml", "--rig", "virtual")
    with writing(path, 3) as process:
        for arguments in (
            ("recover", path, "-o", path, "--force"),
            ("segment", path),
            ("acquire", files / "protocol.toml", *rig, "-o", path, "--force"),
            ("acquire", files / "protocol.toml", *rig, "-o", path, "--resume"),
        ):
            status, message = run(*arguments)
            assert (status, message.count("\n")) == (2, 1), message
            assert f"{path}: is being written to by process {process.pid} on " in message
        assert store(process) == 3
        assert run("recover", path, "-o", files / "so_far.h5")[0] == 0  # reading a file in use is allowed
    assert_whole(path, 4)
    assert_whole(files / "so_far.h5", 4)
    assert not lock_file(path).exists()


def test_a_file_in_use_is_not_called_damaged_by_a_slow_computer(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The process that checks the file waits for longer than its limit of processor time before it begins.
    monkeypatch.setattr(probing, "WITHIN_S", 8.0)
    (files / "sitecustomize.py").write_text("import time\ntime.sleep(9.0)\n")
    with writing(files / "run.h5", 2):
        monkeypatch.setenv("PYTHONPATH", str(files))
        with open_dataset(files / "run.h5") as dataset:
            assert len(dataset.states) == 2


def test_a_killed_run_does_not_keep_its_lock(files: Path, run: Callable[..., tuple[int, str]]) -> None:
    path = files / "run.h5"
    with writing(path, 2) as process:
        process.kill()
        process.wait(PATIENCE_S)
        assert lock_file(path).exists()
        assert run("recover", path, "-o", path, "--force")[0] == 0
    assert_whole(path, 2)
    assert not lock_file(path).exists()


def test_two_names_of_a_file_share_a_lock_that_two_threads_cannot_hold(tmp_path: Path) -> None:
    path, link = tmp_path / "run.h5", tmp_path / "latest.h5"
    link.symlink_to(path)
    assert lock_file(link) == lock_file(path)
    refused = []

    def other() -> None:
        try:
            WriterLock(link)
        except InputError as error:
            refused.append(str(error))

    with only_writer(path), only_writer(link):
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    assert len(refused) == 1
    assert f"process {os.getpid()}" in refused[0]
    WriterLock(path).release()


def test_a_checkpoint_belongs_to_one_fit(tmp_path: Path) -> None:
    path = tmp_path / "fit.jsonl"
    hold = "import sys; from eimi_lab.process.writer_lock import WriterLock; from pathlib import Path\n"
    hold += "lock = WriterLock(Path(sys.argv[1])); print('held', flush=True); sys.stdin.readline()"
    head = Head(fits=("yeoh",), datasets=("0",), options={}, versions={})
    with subprocess.Popen(
        [sys.executable, "-c", hold, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"is being written to by process {process.pid}"):
            Checkpoint(path, head, resume=False)
        process.kill()
    checkpoint = Checkpoint(path, head, resume=False)
    assert lock_file(path).exists()
    del checkpoint
    assert not lock_file(path).exists()


FATES: dict[str, Callable[[Path], object]] = {
    "was deleted": Path.unlink,
    "was moved": lambda path: path.rename(path.with_name("moved.h5")),
    "was replaced": lambda path: os.replace(path.with_name("specimen.toml"), path),
    "was moved, and another file now has the name of the dataset": lambda path: (
        path.rename(path.with_name("moved.h5")),
        path.write_text("something else"),
    ),
}


@pytest.mark.parametrize("fate", FATES)
def test_a_run_whose_file_is_deleted_continues_in_a_new_file(
    files: Path, fate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    path = files / "run.h5"
    with DatasetWriter(path, header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(2):
            writer.append_state([Frame(image(k), k, 0.0)], current_A=k / 10, field_mT=0.0)
        FATES[fate](path)
        content = path.read_bytes() if path.exists() else None
        writer.append_state([Frame(image(2), 2, 0.0)], current_A=0.2, field_mT=0.0)
        beside = files / "run-continued.h5"
        assert writer.path == beside
        message = capsys.readouterr().err
        assert message == (
            f"eimi: warning: {path} {fate} during the run; the 3 states stored so far and all following states are in "
            f"{beside}\n"
        )
        with open_dataset(beside) as dataset:  # stored before the next state is written
            assert len(dataset.states) == 3
        with pytest.raises(InputError, match="is being written to"):
            subprocess_lock(beside)
        writer.append_state([Frame(image(3), 3, 0.0)], current_A=0.3, field_mT=0.0)
    assert_whole(beside, 4)
    assert (path.read_bytes() if path.exists() else None) == content
    if "moved" in fate:
        assert_whole(files / "moved.h5", 3)
    assert not [*files.glob(".*.lock")]
    with h5py.File(beside) as file:
        assert file["entry/sessions/first_state"][()].tolist() == [0]


def subprocess_lock(path: Path) -> None:
    # Lock a dataset in another process, which then ends; raise InputError if the lock is refused.
    take = "import sys; from eimi_lab.process.writer_lock import WriterLock; from pathlib import Path\n"
    take += "from eimi_lab.process.errors import InputError\ntry:\n    WriterLock(Path(sys.argv[1]))\n"
    take += "except InputError as error:\n    sys.exit(str(error))"
    done = subprocess.run([sys.executable, "-c", take, str(path)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(done.stderr)


def test_moving_the_folder_of_a_run_loses_no_state(files: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    folder = files / "today"
    folder.mkdir()
    with DatasetWriter(folder / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
        writer.append_state([Frame(image(0), 0, 0.0)], current_A=0.0, field_mT=0.0)
        folder.rename(files / "yesterday")
        writer.append_state([Frame(image(1), 1, 0.0)], current_A=0.1, field_mT=0.0)
    assert_whole(folder / "run-continued.h5", 2)
    assert_whole(files / "yesterday" / "run.h5", 2)


def test_a_file_without_states_that_was_replaced_is_not_removed(files: Path) -> None:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    path = files / "run.h5"
    with DatasetWriter(path, header, Frame(image(0), 0, 0.0)):
        path.unlink()
        path.write_text("something else")
    assert path.read_text() == "something else"


def test_a_file_overwritten_by_another_program_ends_the_run(files: Path) -> None:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    path = files / "run.h5"
    with writing(files / "other.h5", 1):
        pass
    other = (files / "other.h5").read_bytes()
    with DatasetWriter(path, header, Frame(image(0), 0, 0.0)) as writer:
        writer.append_state([Frame(image(0), 0, 0.0)], current_A=0.0, field_mT=0.0)
        shutil.copyfile(files / "other.h5", path)
        with pytest.raises(StorageFailed, match="another program wrote into the file during the run, so the 1 states"):
            writer.append_state([Frame(image(1), 1, 0.0)], current_A=0.1, field_mT=0.0)
    assert path.read_bytes() == other


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_run_through_a_link_writes_the_file_to_which_the_link_leads(files: Path, number: signal.Signals) -> None:
    (files / "disk").mkdir()
    link = files / "run.h5"
    link.symlink_to(files / "disk" / "today.h5")
    with writing(link, 2) as process:
        process.send_signal(number)
    assert link.is_symlink()
    with open_dataset(files / "disk" / "today.h5") as dataset:
        assert len(dataset.states) == 2


def test_an_output_is_written_to_the_file_to_which_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    link = tmp_path / "out.txt"
    link.symlink_to(Path("disk") / "real.txt")
    with whole_file(link, force=False) as temporary:  # the link does not lead to a file yet
        temporary.write_text("first")
    with pytest.raises(InputError, match="exists already"), whole_file(link, force=False):
        pass
    with whole_file(link, force=True) as temporary:
        temporary.write_text("second")
    assert link.is_symlink()
    assert (tmp_path / "disk" / "real.txt").read_text() == "second"
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a.csv").symlink_to(tmp_path / "disk" / "a.csv")
    with whole_folder(tmp_path / "folder", force=True) as unfinished:
        (unfinished / "a.csv").write_text("third")
    assert (tmp_path / "folder" / "a.csv").is_symlink()
    assert (tmp_path / "disk" / "a.csv").read_text() == "third"
    assert sorted(path.name for path in (tmp_path / "disk").iterdir()) == ["a.csv", "real.txt"]


def test_broken_links_are_refused_in_one_line(tmp_path: Path) -> None:
    loop, lost = tmp_path / "loop.h5", tmp_path / "lost.h5"
    loop.symlink_to(loop)
    lost.symlink_to(tmp_path / "gone" / "run.h5")
    with pytest.raises(InputError, match=r"loop\.h5: is a symbolic link that cannot be followed"):
        WriterLock(loop)
    with pytest.raises(InputError, match=r"lost\.h5: there is no folder .*gone"), whole_file(lost, force=True):
        pass


@pytest.mark.parametrize("plant", [Path.symlink_to, Path.hardlink_to])
def test_a_lock_file_of_an_attacker_harms_no_other_file(tmp_path: Path, plant: Callable[[Path, Path], None]) -> None:
    path, diary = tmp_path / "run.h5", tmp_path / "diary.txt"
    diary.write_text("Dear diary")
    plant(lock_file(path), diary)
    with suppress(InputError):
        WriterLock(path).release()
    assert diary.read_text() == "Dear diary"


def test_a_lock_file_that_is_a_link_or_a_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    lock_file(path).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"\.run\.h5\.lock: is a link, but .*; remove the link"):
        WriterLock(path)
    assert not (tmp_path / "elsewhere").exists()
    lock_file(path).unlink()
    os.mkfifo(lock_file(path))
    assert not is_being_written(path)
