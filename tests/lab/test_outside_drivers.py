"""Drivers of another package need no base class: they pass the checks, run whole protocols, and give clear errors."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from eimi_drivers.cameras import CAMERAS, open_camera
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.scpi import ScpiDialect
from eimi_drivers.emulators.serve import emulate, serve_pty
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Limits, UnknownDriver, UnusableDriver
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.testing import check_camera, check_supply
from eimi_lab.acquisition.added_driver import pack
from eimi_lab.acquisition.guardian import Ward, guarding
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.detached import LONGEST_ARGUMENT
from tests.patience import PATIENCE_S

PACKAGE = Path(__file__).parents[1] / "shared" / "outside" / "mine_lab.py"
LIMITS = Limits(current_A=1.0, voltage_V=12.0)
ENTRY_POINTS = """
[eimi_drivers.supplies]
mine = mine_lab:Mine

[eimi_drivers.cameras]
eye = mine_lab:Eye
"""


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # A folder on Python's path with the package `mine_lab`, which does not announce its drivers.
    folder = tmp_path / "site-packages"
    folder.mkdir()
    shutil.copy(PACKAGE, folder)
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    sys.modules.pop("mine_lab", None)


@pytest.fixture
def lab(outside: Path) -> Any:
    # The module `mine_lab` with a supply driver and a camera driver.
    import mine_lab

    return mine_lab


@pytest.fixture
def added(lab: Any) -> Iterator[None]:
    # Register the drivers of `mine_lab` under the names "mine" and "eye" for one test.
    SUPPLIES["mine"], CAMERAS["eye"] = lab.Mine, lab.Eye
    yield
    del SUPPLIES["mine"], CAMERAS["eye"]


@pytest.fixture
def rig(files: Path) -> Callable[..., Path]:
    # Return a function that writes rig.toml with the drivers of `mine_lab`, and returns its path.

    def write(address: str, supply: str = "mine", camera: str = "eye") -> Path:
        (files / "rig.toml").write_text(f"""
name = "outside"
calibration = "calibration.toml"
supply = {{ driver = "{supply}", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "{camera}", source = "wall" }}
""")
        return files / "rig.toml"

    return write


def announce(folder: Path) -> None:
    # Write the metadata by which the package `mine_lab` announces its drivers.
    information = folder / "mine_lab-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: mine-lab\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(ENTRY_POINTS)


def eimi(folder: Path, *arguments: object, outside: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "eimi_lab", *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(outside)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_a_supply_that_inherits_nothing_conforms(lab: Any) -> None:
    assert lab.Mine.__mro__ == (lab.Mine, object)
    check_supply(lab.Mine, ScpiDialect, answer_within_s=60.0)


def test_a_camera_that_inherits_nothing_conforms(lab: Any) -> None:
    assert lab.Eye.__mro__ == (lab.Eye, object)
    check_camera(lab.Eye, "wall", absent="nowhere")


def test_a_whole_run_works_with_announced_drivers(outside: Path, files: Path, rig: Callable[..., Path]) -> None:
    announce(outside)
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("scpi", coil)) as port:
        arguments = ("acquire", "protocol.toml", "--specimen", "specimen.toml", "--rig", rig(port), "-o", "run.h5")
        done = eimi(files, *arguments, outside=outside)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    assert not coil.state.output
    with open_dataset(files / "run.h5") as dataset:
        assert [state.current_A for state in dataset.states] == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=0.005)


def test_a_driver_that_is_too_large_for_the_argument_of_a_process_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SUPPLIES, "added", lambda: {"korad"})
    packed = pack("korad")
    monkeypatch.setattr("eimi_lab.acquisition.added_driver.LONGEST_ARGUMENT", len(packed))
    assert pack("korad") == packed
    monkeypatch.setattr("eimi_lab.acquisition.added_driver.LONGEST_ARGUMENT", len(packed) - 1)
    with pytest.raises(UnusableDriver, match="the supply driver 'korad' is too large to be sent to the process that"):
        pack("korad")


def test_the_longest_text_of_a_driver_is_an_argument_that_the_system_accepts() -> None:
    ward = Ward("mine", "/dev/ttyUSB0", 1.0, 10.0, '"' + "x" * (LONGEST_ARGUMENT - 2) + '"')
    subprocess.run(["true", json.dumps(asdict(ward))], check=True, timeout=PATIENCE_S)


@pytest.mark.usefixtures("added")
def test_a_whole_run_works_with_added_drivers(files: Path, rig: Callable[..., Path]) -> None:
    coil = CoilSupply(WallClock())
    protocol, specimen = load_protocol(files / "protocol.toml"), load_specimen(files / "specimen.toml")
    with serve_pty(emulate("scpi", coil)) as port:
        loaded = load_rig(rig(port))
        with open_bench(loaded, specimen, protocol.limits) as bench:
            acquire(protocol, specimen, loaded, bench, files / "run.h5", lambda words: None)
    assert not coil.state.output
    with open_dataset(files / "run.h5") as dataset:
        assert len(dataset.states) == 4


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("where", ["module", "script"])
def test_the_guardian_switches_off_with_an_added_driver(lab: Any, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    if where == "script":  # a class in a notebook cannot be imported by another process

        class Local(lab.Mine):
            pass

        Local.__module__ = "__main__"
        SUPPLIES["mine"] = Local
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("scpi", coil)) as port:
        coil.set_voltage(10.0)
        coil.set_current(0.5)
        coil.switch(True)
        with guarding(Ward("mine", port, 1.0, 10.0, pack("mine"))) as guardian:
            guardian.arm()
        assert guardian._process.wait(60) == 0
    assert not coil.state.output
    assert coil.state.set_current_A == 0.0


@pytest.mark.usefixtures("added")
def test_a_driver_that_cannot_be_sent_to_the_guardian_is_refused() -> None:
    import threading

    lock = threading.Lock()
    SUPPLIES["mine"] = lambda link, limits, clock: lock
    with pytest.raises(UnusableDriver, match=r"'mine' cannot be sent .* in a module of its own"):
        pack("mine")


@pytest.mark.parametrize("member", ["identify", "set_voltage", "set_current", "set_output", "output_on", "measure",
                                    "check", "safe_off", "close"])  # fmt: skip
@pytest.mark.parametrize("dry", [True, False])
def test_each_missing_member_of_a_supply_is_one_line_and_status_2(
    outside: Path, files: Path, rig: Callable[..., Path], run: Any, member: str, dry: bool
) -> None:
    announce(outside)
    spoil(outside, "Mine", member)
    arguments = ["acquire", files / "protocol.toml", "--specimen", files / "specimen.toml", "--rig", rig("/dev/none")]
    status, message = run(*arguments, *(["--dry-run"] if dry else ["-o", files / "run.h5"]))
    assert (status, message.count("\n")) == (2, 1)
    assert f"the supply driver 'mine' (mine_lab.Mine) cannot be used: {member} is missing" in message
    assert not (files / "run.h5").exists()


@pytest.mark.parametrize("member", ["identify", "flush", "grab", "close"])
def test_each_missing_member_of_a_camera_is_one_line_and_status_2(
    outside: Path, files: Path, rig: Callable[..., Path], run: Any, member: str
) -> None:
    announce(outside)
    spoil(outside, "Eye", member)
    arguments = ["acquire", files / "protocol.toml", "--specimen", files / "specimen.toml", "-o", files / "run.h5"]
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("scpi", coil)) as port:
        status, message = run(*arguments, "--rig", rig(port))
    assert (status, message.count("\n")) == (2, 1)
    assert f"the camera driver 'eye' (mine_lab.Eye) cannot be used: {member} is missing" in message
    assert not (files / "run.h5").exists()


@pytest.mark.parametrize("member", ["set_current", "set_output", "measure", "check"])
def test_an_error_of_a_drivers_own_kind_ends_the_run_in_one_line_with_the_coil_off(
    outside: Path, files: Path, rig: Callable[..., Path], run: Any, member: str
) -> None:
    with (outside / "mine_lab.py").open("a") as module:
        module.write(VENDOR_ERROR.format(member=member))
    import mine_lab

    SUPPLIES["mine"], CAMERAS["eye"] = mine_lab.Mine, mine_lab.Eye
    coil = CoilSupply(WallClock())
    try:
        with serve_pty(emulate("scpi", coil)) as port:
            arguments = ["acquire", files / "protocol.toml", "--specimen", files / "specimen.toml", "--rig", rig(port)]
            status, message = run(*arguments, "-o", files / "run.h5")
    finally:
        del SUPPLIES["mine"], CAMERAS["eye"]
    assert (status, "Traceback" in message) == (1, False), message
    error = f"mine supply {port}: its driver raised VendorError: code 7 in {member}"
    assert error in [line for line in message.splitlines() if line.startswith("eimi: ")][-1]
    assert not coil.state.output
    assert coil.state.set_current_A == 0.0


VENDOR_ERROR = """

class VendorError(Exception):
    pass


def _fail_after(act):
    def failing(self, *arguments):
        answer = act(self, *arguments)
        if self._switched_on:
            raise VendorError("code 7")
        return answer

    return failing


Mine.{member} = _fail_after(Mine.{member})
"""


def spoil(outside: Path, driver: str, member: str) -> None:
    # Rename the method `member` in the copy of mine_lab.py, so that the driver lacks it.
    path = outside / "mine_lab.py"
    head, _, body = path.read_text().partition(f"class {driver}:")
    assert f"def {member}(" in body
    path.write_text(f"{head}class {driver}:{body.replace(f'def {member}(', f'def _no_{member}(', 1)}")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            {"measure": lambda self, channel: None},
            r"measure is called as measure\(channel\), but should be measure\(\)",
        ),
        ({"set_current": lambda self: None}, r"set_current is called as set_current\(\), but .*\(current_A: float\)"),
        ({"check": "fine"}, r"check is 'fine', but should be check\(\) -> None"),
        (
            {"__init__": lambda self, address: None},
            r"called as Mine\(address\), .*Mine\(link: Any, limits: Limits, clock",
        ),
        ({"connect": lambda: None}, r"connect cannot be called as connect\(address\)"),
        ({"__init__": lambda self, *anything: None}, r"limits is missing \(needed: an attribute of type Limits\)"),
    ],
)
def test_a_wrong_signature_is_named(lab: Any, change: dict[str, object], expected: str) -> None:
    SUPPLIES["mine"] = type("Mine", (lab.Mine,), change)
    try:
        with pytest.raises(UnusableDriver, match=expected) as caught:
            open_supply("mine", "/dev/none", LIMITS)
    finally:
        del SUPPLIES["mine"]
    assert "\n" not in str(caught.value)


def test_the_driver_that_a_function_opens_is_checked_and_closed(lab: Any) -> None:
    closed = []
    CAMERAS["eye"] = lambda source, settings: type("Blind", (), {"close": lambda self: closed.append(source)})()
    try:
        with pytest.raises(UnusableDriver, match=r"identify is missing.*flush is missing.*grab is missing"):
            open_camera("eye", "wall")
    finally:
        del CAMERAS["eye"]
    assert closed == ["wall"]


def test_a_driver_without_a_transport_has_no_transcript(lab: Any, tmp_path: Path) -> None:
    SUPPLIES["mine"] = lab.Mine
    try:
        with pytest.raises(UnusableDriver, match=r"no function connect\(address\), so its messages cannot be recorded"):
            open_supply("mine", "/dev/none", LIMITS, transcript=tmp_path / "wire.txt")
    finally:
        del SUPPLIES["mine"]
    assert not (tmp_path / "wire.txt").exists()


@pytest.mark.parametrize(("drivers", "own"), [(SUPPLIES, "korad"), (CAMERAS, "opencv")])
def test_drivers_are_added_and_removed_in_the_same_way_as_laws(drivers: Any, own: str) -> None:
    before = list(drivers)
    drivers["mine"] = first = lambda *anything: None
    assert drivers["mine"] is first
    assert list(drivers) == [*before, "mine"]
    drivers["mine"] = second = lambda *anything: None
    assert (drivers["mine"], len(drivers)) == (second, len(before) + 1)
    del drivers["mine"]
    assert list(drivers) == before
    for taken in (own, "virtual"):
        with pytest.raises(ValueError, match=f"'{taken}' belongs to eimi; give your driver another name"):
            drivers[taken] = first
    with pytest.raises(ValueError, match=f"'{own}' was not added by this program and cannot be removed"):
        del drivers[own]
    with pytest.raises(TypeError, match="'mine' should be a class or a function, not 3"):
        drivers["mine"] = 3
    with pytest.raises(KeyError, match=r"there is no .* driver 'mine'"):
        del drivers["mine"]
    assert drivers.get("mine") is None
    assert list(drivers) == before


@pytest.mark.parametrize("act", [SUPPLIES.__getitem__, partial(open_supply, address="a", limits=LIMITS)])
def test_the_error_for_a_wrong_name_suggests_the_most_similar_name(act: Callable[[str], object]) -> None:
    with pytest.raises(
        UnknownDriver, match=r"^there is no supply driver 'korat'; the names are: .*did you mean 'korad'\?$"
    ):
        act("korat")
    with pytest.raises(KeyError, match=r"the names are: [^?]*$"):
        act("polaroid")


@pytest.mark.usefixtures("added")
def test_a_rig_may_name_an_added_driver_and_a_wrong_name_gives_a_suggestion(
    rig: Callable[..., Path], files: Path, run: Any
) -> None:
    assert load_rig(rig("here")).supply.driver == "mine"
    arguments = ["acquire", files / "protocol.toml", "--specimen", files / "specimen.toml", "--dry-run", "--rig"]
    for names, told in (
        ({"supply": "mime"}, "supply.driver = 'mime' is not a driver"),
        ({"camera": "eyes"}, "camera.driver = 'eyes' is not a driver"),
    ):
        status, message = run(*arguments, rig("here", **names))
        assert (status, message.count("\n")) == (2, 1)
        assert told in message
        assert re.search(r"did you mean '(mine|eye)'\?$", message)


@pytest.mark.usefixtures("added")
def test_added_drivers_are_listed_and_work_in_a_dry_run(
    rig: Callable[..., Path], files: Path, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    from eimi_drivers.discovery import discover

    assert {"supply drivers of this program: mine", "camera drivers of this program: eye"} <= set(discover().notes)
    protocol, specimen = files / "protocol.toml", files / "specimen.toml"
    status, _ = run("acquire", protocol, "--specimen", specimen, "--dry-run", "--rig", rig("here"))
    assert status == 0
