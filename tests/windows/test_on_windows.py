"""Files, locks, processes and ports work on Windows. The script `.ci/windows` runs these tests with Wine."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.coil_line import serve_coil
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Limits
from eimi_drivers.supplies.supply_names import open_supply
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.process import replacing
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_file
from eimi_lab.process.paths import followed, reachable
from eimi_lab.process.pipes import never_wait_to_write, readable
from eimi_lab.process.writer_lock import WriterLock, is_being_written, lock_file
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.skipif(sys.platform != "win32", reason="needs Windows; `.ci/windows` has it under Wine")

EIMI = (sys.executable, "-X", "utf8=0", "-m", "eimi_lab")
"""The command that runs the program without UTF-8 as the encoding of the locale."""

GENERIC_READ, FILE_SHARE_READ, OPEN_EXISTING = 0x80000000, 1, 3
"""Access, sharing and way of opening for CreateFileW (Microsoft, winnt.h and fileapi.h)."""
INVALID_HANDLE = ctypes.c_void_p(-1).value


def eimi(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*EIMI, *arguments], cwd=folder, capture_output=True, encoding="utf-8", timeout=PATIENCE_S, check=False
    )


def wait_for(path: Path) -> None:
    until = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert time.monotonic() < until
        time.sleep(0.02)


@contextmanager
def another_process(folder: Path, code: str) -> Iterator[subprocess.Popen[bytes]]:
    # Run code in another process, which then waits; yield it, and kill it at the end of the context.
    process = subprocess.Popen(
        [sys.executable, "-c", code + "\nopen('ready', 'w').close(); input()"], cwd=folder, stdin=-1
    )
    try:
        wait_for(folder / "ready")
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def indexed(folder: Path) -> Iterator[set[tuple[str, int]]]:
    # Open every new or changed file for 0.2 s, as a virus scanner does; yield the opened files. While a file is open,
    # no other program can write, move or remove the file.
    kernel = ctypes.WinDLL("kernel32")
    kernel.CreateFileW.restype = ctypes.c_void_p
    held: set[tuple[str, int]] = set()
    ended = threading.Event()

    def index() -> None:
        while not ended.wait(0.05):
            for path in folder.rglob("*"):
                with suppress(OSError):
                    mark = (str(path), path.stat().st_mtime_ns)
                    if mark in held or path.is_dir():
                        continue
                    handle = kernel.CreateFileW(str(path), GENERIC_READ, FILE_SHARE_READ, None, OPEN_EXISTING, 0, None)
                    if handle != INVALID_HANDLE:
                        held.add(mark)
                        threading.Timer(0.2, kernel.CloseHandle, [ctypes.c_void_p(handle)]).start()

    thread = threading.Thread(target=index)
    thread.start()
    try:
        yield held
    finally:
        ended.set()
        thread.join()


def test_the_whole_chain_runs_in_a_folder_with_an_umlaut_while_an_indexer_opens_every_file(tmp_path: Path) -> None:
    folder = tmp_path / "Prüfstand µ"
    folder.mkdir()
    with indexed(folder) as held:
        done = eimi(folder, "demo", "--quick")
    assert done.returncode == 0, done.stderr
    assert len(held) >= 3
    assert "initial shear modulus 46384 Pa" in done.stdout
    assert "µm" in done.stdout
    assert sorted(path.name for path in (folder / "eimi-demo").iterdir()) == ["dataset.h5", "fits.json", "report.html"]


def test_a_file_that_another_program_has_open_for_a_moment_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    path.write_bytes(b"old")
    scanned = path.open("rb")
    threading.Timer(0.5, scanned.close).start()
    write_file(path, "neu: µ", force=True)
    assert path.read_bytes() == "neu: µ".encode()


def test_the_error_about_a_file_that_stays_open_names_it_and_no_temporary_file_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replacing, "TRY_FOR_S", 0.3)
    path = tmp_path / "fits.json"
    path.write_bytes(b"old")
    with path.open("rb"), pytest.raises(PermissionError, match=r"fits\.json: cannot be replaced .* close the file"):
        write_file(path, "new", force=True)
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["fits.json"]


def test_a_second_writer_is_refused_until_the_first_has_died(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    code = "from pathlib import Path\nfrom eimi_lab.process.writer_lock import WriterLock\n"
    with another_process(tmp_path, code + "lock = WriterLock(Path('run.h5'))"):
        assert is_being_written(path)
        with pytest.raises(InputError, match="is being written to by process"):
            WriterLock(path)
    lock = WriterLock(path)
    lock.release()
    assert not lock_file(path).exists()


def test_a_full_pipe_does_not_delay_its_writer() -> None:
    reading, writing = os.pipe()
    assert not readable(reading, 0.0)
    never_wait_to_write(writing)

    def fill() -> None:
        for _ in range(1 << 16):
            os.write(writing, b"x" * 64)

    with pytest.raises(OSError, match=r"\[Errno"):
        fill()
    assert readable(reading, 0.0)
    os.close(writing)
    while os.read(reading, 4096):
        pass
    assert readable(reading, 0.0)  # the other end of the pipe
    os.close(reading)


GUARDED = """
import json, sys, time
from eimi_lab.acquisition.guardian import Guardian, Ward
guardian = Guardian(Ward("scpi", sys.argv[1], 1.0, 10.0))
guardian.arm()
open("ready", "w")
while True:
    guardian.beat()
    guardian.check()
    time.sleep(0.05)
"""


def test_the_guardian_of_a_run_that_was_killed_switches_the_coil_off(tmp_path: Path) -> None:
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("scpi", coil)) as address:
        supply = open_supply("scpi", address, Limits(1.0, 10.0))
        supply.set_voltage(10.0)
        run = subprocess.Popen([sys.executable, "-c", GUARDED, address], cwd=tmp_path)
        wait_for(tmp_path / "ready")
        supply.set_current(0.5)
        supply.set_output(True)
        supply.close()
        assert coil.state.output
        run.kill()  # on Windows, this calls TerminateProcess
        run.wait()
        until = time.monotonic() + PATIENCE_S
        while coil.state.output:
            assert time.monotonic() < until
            time.sleep(0.02)
        assert coil.state.set_current_A == 0.0


def test_a_supply_on_a_com_port_above_9_answers() -> None:
    port = os.environ.get("EIMI_TESTS_COM_PORT")
    if port is None:
        pytest.skip("needs an emulated Korad on the port that EIMI_TESTS_COM_PORT names, as `.ci/windows` starts one")
    assert int(port.removeprefix("COM")) > 9
    supply = open_supply("korad", port, Limits(1.0, 10.0))
    supply.set_voltage(10.0)
    supply.set_current(0.5)
    supply.set_output(True)
    assert supply.output_on()
    supply.safe_off()
    assert not supply.output_on()
    supply.close()


def test_an_emulated_supply_without_a_tcp_port_is_refused_in_one_line(tmp_path: Path) -> None:
    done = eimi(tmp_path, "emulate", "korad")
    assert done.returncode == 1
    assert done.stderr == "eimi: Windows has no pseudo-terminals; serve on a TCP port: `eimi emulate SUPPLY --tcp 0`\n"


def test_a_pattern_stands_for_the_files_that_match_it(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    for day in ("monday", "tuesday"):
        (tmp_path / "runs" / f"{day}.h5").write_text("no dataset")
    done = eimi(tmp_path, "report", "runs/*.h5", "-o", "report.html")
    assert done.returncode == 2
    assert "monday.h5: is not an HDF5 file" in done.stderr


def test_files_in_a_folder_with_a_long_path_are_written_locked_and_read(tmp_path: Path) -> None:
    plain = tmp_path.joinpath(*["x" * 60] * 5)
    assert len(str(plain)) > 300
    done = eimi(tmp_path, "init", str(plain))
    assert done.returncode == 0, done.stderr
    folder = reachable(plain)
    assert str(folder).startswith("\\\\?\\")
    assert {"calibration.toml", "protocol.toml", "specimen.toml"} <= {path.name for path in folder.iterdir()}
    assert load_protocol(plain / "protocol.toml").currents_A
    (folder / "shape.csv").write_text("x_mm,y_mm\n0,0\n10,0.2\n20,0.5\n30,0.9\n")
    (folder / "below").mkdir()
    shipped = Path(__file__).parents[2] / "protocols" / "specimens" / "type1.toml"
    text = shipped.read_text(encoding="utf-8").replace("[specimen]", '[specimen]\nrest_shape = "../shape.csv"', 1)
    (folder / "below" / "specimen.toml").write_text(text, encoding="utf-8")
    assert "30.0, 0.9" in load_specimen(plain / "below" / "specimen.toml").text
    path = folder / "fits.json"
    write_file(path, "µ", force=False)
    lock = WriterLock(path)
    assert is_being_written(path)
    lock.release()
    assert not lock_file(path).exists()
    assert path.read_bytes() == "µ".encode()
    assert DataFolder(followed(folder)).inside("fits.json").name == "fits.json"


CLOSED = """
import threading, time
from pathlib import Path
from eimi_lab.cli import main
from eimi_lab.process import console

def close():
    while not Path("close").exists():
        time.sleep(0.02)
    console._handlers[-1](2)  # CTRL_CLOSE_EVENT

threading.Thread(target=close, daemon=True).start()
main()
"""
"""A program in which a thread calls the handler of console events, as Windows does when a window is closed."""

RIG = """
name = "emulated"
calibration = "virtual_calibration.toml"
supply = {{ driver = "scpi", address = "{address}", limits = {{ current_A = 2.0, voltage_V = 30.0 }} }}
camera = {{ driver = "virtual", source = "{coil}" }}

[virtual]
seed = 1
coil_time_constant_s = 0.05
current_noise_A = 0.0
frame_size_px = [640, 512]
mesh = [8, 1, 1]
materials = "virtual_materials.toml"
"""


def test_a_run_whose_console_is_closed_ends_with_the_coil_off(tmp_path: Path) -> None:
    shipped = Path(__file__).parents[2] / "protocols" / "rigs"
    for name in ("virtual_calibration.toml", "virtual_materials.toml"):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("scpi", coil)) as address, serve_coil(coil) as line:
        (tmp_path / "rig.toml").write_text(RIG.format(address=address, coil=line))
        bench = ["--specimen", "type1", "--rig", "rig.toml", "-o", "run.h5"]
        run = subprocess.Popen(
            [sys.executable, "-c", CLOSED, "acquire", "dragon_skin_10_quick", *bench],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )
        until = time.monotonic() + PATIENCE_S
        while not (coil.state.output and coil.state.set_current_A > 0.0):
            assert time.monotonic() < until
            assert run.poll() is None, run.communicate()
            time.sleep(0.02)
        (tmp_path / "close").touch()
        message = run.communicate(timeout=PATIENCE_S)[1]
    assert "stopped by SIGBREAK: the coil is off" in message
    assert not coil.state.output
