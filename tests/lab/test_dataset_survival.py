"""Stored states (load steps) survive a full disk, a folder that refuses files, and a file that is open elsewhere."""

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
from eimi_lab.dataset.file_system import network_file_system
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from tests.patience import PATIENCE_S

# A limit of the size of files imitates a full disk: HDF5 gets the same kind of error.
WRITE_UNTIL_FULL = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter

folder, size, states, settling = Path(sys.argv[1]), *map(int, sys.argv[2:])
header = Header(load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml"),
                load_protocol(folder / "protocol.toml"))
image = lambda k: np.random.default_rng(k).integers(0, 255, (96, 128)).astype(np.uint8)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
try:
    with DatasetWriter(folder / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(states):
            moments = [Moment(Frame(image(99), n, 0.0), 1.0, 0.5, k / 10) for n in range(settling)]
            writer.append_state([Frame(image(k), k, 0.0)], current_A=k / 10, field_mT=k * 0.47, transient=moments)
            print(k, flush=True)
except StorageFailed as error:
    print(error, file=sys.stderr)
"""


def write_until_full(folder: Path, size: int, states: int = 8, settling: int = 0) -> tuple[int, str]:
    # Write states to a file of at most `size` bytes; return the number of reported states and the text on stderr.
    # settling: number of frames in each state before the beam is at rest.
    command = [sys.executable, "-c", WRITE_UNTIL_FULL, str(folder), *map(str, (size, states, settling))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    return len(done.stdout.split()), done.stderr


@pytest.mark.parametrize(
    ("size", "settling"),
    [
        (70_000, 0),
        (150_000, 12),
        *(pytest.param(size, 0, marks=pytest.mark.slow) for size in range(36_000, 120_000, 1_500)),
        *(pytest.param(size, 12, marks=pytest.mark.slow) for size in range(36_000, 400_000, 9_500)),
    ],
)
def test_a_full_disk_costs_no_stored_state(files: Path, size: int, settling: int) -> None:
    acknowledged, message = write_until_full(files, size, settling=settling)
    assert acknowledged < 8
    left = f"the {acknowledged} states stored so far are safe" if acknowledged else "no state was stored yet"
    assert f"cannot be written any more: File too large; {left}" in message
    assert message.count("\n") == 1
    path = files / "run.h5"
    if not acknowledged:
        assert not path.exists()
        return
    assert recover(path, path, force=True) >= acknowledged
    with open_dataset(path) as dataset:
        for k in range(acknowledged):
            expected = np.random.default_rng(k).integers(0, 255, (96, 128)).astype(np.uint8)
            assert np.array_equal(dataset.images(k)[0], expected)


def crashed(files: Path) -> Path:
    # A dataset with at least two states (load steps) that its writer never closed.
    assert write_until_full(files, 70_000)[0] > 1
    return files / "run.h5"


@pytest.mark.parametrize("share", [0.1, *(pytest.param(share, marks=pytest.mark.slow) for share in (0.001, 0.35))])
def test_a_crashed_file_that_is_damaged_as_well_ends_in_one_line(files: Path, share: float) -> None:
    path = crashed(files)
    path.write_bytes(path.read_bytes()[: max(48, int(share * path.stat().st_size))])
    with pytest.raises(InputError, match=r"run\.h5: is (a damaged HDF5 file \(.+\)|damaged)"):
        recover(path, files / "whole.h5")
    with pytest.raises(InputError, match=r"run\.h5: is "), open_dataset(path):
        pass
    assert not (files / "whole.h5").exists()


def a_frame(files: Path, draw: Callable[..., np.ndarray]) -> tuple[Header, Frame]:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    return header, Frame(draw(0), 0, 0.0)


def test_states_can_be_stored_while_a_reader_has_the_file_open(files: Path, frame: Callable[..., np.ndarray]) -> None:
    header, first = a_frame(files, frame)
    reader = f"""
import sys
from eimi_lab.dataset.reading import open_dataset
with open_dataset({str(files / "run.h5")!r}) as dataset:
    print(len(dataset.states), flush=True)
    sys.stdin.readline()
    print(dataset.images(0).shape, flush=True)
"""
    with DatasetWriter(files / "run.h5", header, first) as writer:
        writer.append_state([first], current_A=0.0, field_mT=0.0)
        with subprocess.Popen(
            [sys.executable, "-c", reader], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "1\n"
            for k in range(1, 4):
                writer.append_state([first], current_A=k / 10, field_mT=0.0)
            out, _ = process.communicate("\n", timeout=PATIENCE_S)
            assert out == "(1, 96, 128)\n"
            assert process.returncode == 0
    with open_dataset(files / "run.h5") as dataset:
        assert (len(dataset.states), dataset.finished) == (4, True)


def test_a_finished_file_open_elsewhere_is_not_written_to(files: Path, frame: Callable[..., np.ndarray]) -> None:
    header, first = a_frame(files, frame)
    path = files / "run.h5"
    with DatasetWriter(path, header, first) as writer:
        writer.append_state([first], current_A=0.0, field_mT=0.0)
    before = path.read_bytes()
    with h5py.File(path, "r"), pytest.raises(InputError, match="close every other program that has it open"):
        DatasetWriter.resume(path)
    assert path.read_bytes() == before


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that takes no files, not even root's")
def test_a_folder_that_accepts_no_files_is_refused_in_one_line(files: Path, frame: Callable[..., np.ndarray]) -> None:
    header, first = a_frame(files, frame)
    with pytest.raises(
        InputError,
        match=r"/proc/run\.h5: (no file can be created in the folder /proc|the folder /proc cannot be written to)",
    ):
        DatasetWriter(Path("/proc/run.h5"), header, first)


MOUNTS = """\
/dev/sda1 / ext4 rw 0 0
server:/data /mnt/my\\040data nfs4 rw 0 0
/dev/sdb1 /mnt/my\\040data/local xfs rw 0 0
me@host: {sshfs} fuse.sshfs rw 0 0
"""


def test_network_file_systems_are_recognised(tmp_path: Path) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(MOUNTS.format(sshfs=tmp_path / "remote"))
    assert network_file_system(Path("/mnt/my data/runs"), mounts) == "nfs4"
    assert network_file_system(Path("/mnt/my data/local/runs"), mounts) is None
    assert network_file_system(Path("/mnt/my database"), mounts) is None
    assert network_file_system(tmp_path / "remote" / "runs", mounts) == "fuse.sshfs"
    assert network_file_system(tmp_path, mounts) is None
    assert network_file_system(tmp_path, tmp_path / "no table") is None


def test_a_run_on_a_network_file_system_prints_a_warning(
    files: Path, run: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    (files / "mounts").write_text(f"/dev/sda1 / ext4 rw 0 0\nserver:/data {files / 'share'} nfs4 rw 0 0\n")
    monkeypatch.setattr(network_file_system, "__defaults__", (files / "mounts",))
    (files / "share").mkdir()
    (files / "rig.toml").write_text(f"""
name = "none"
calibration = "calibration.toml"
supply = {{ driver = "korad", address = "{files / "not-there"}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = 0 }}
""")
    arguments = ("acquire", files / "protocol.toml", "--specimen", files / "specimen.toml", "--rig", files / "rig.toml")
    status, message = run(*arguments, "-o", files / "share" / "run.h5")
    assert status == 1  # there is no such supply
    assert message.splitlines()[0] == (
        f"eimi: warning: {files / 'share' / 'run.h5'} is on a network drive (nfs4): after a crash, stored states may "
        "be lost; a local disk is safer"
    )
    assert "warning" not in run(*arguments, "-o", files / "run.h5")[1]
