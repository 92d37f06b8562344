"""A dry run prints the steps and messages of a run, and touches no instrument."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import DIALECTS
from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.supplies import SUPPLIES
from eimi_lab.acquisition.dry_run import _BeamAtRest, dry_run
from eimi_lab.acquisition.heating import hottest
from eimi_lab.config.interlock import Interlock
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError


def tell(setup: Any, driver: str, address: str) -> list[str]:
    supply = setup.rig.supply.model_copy(update={"driver": driver, "address": address})
    messages: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig.model_copy(update={"supply": supply}), messages.append)
    return messages


def messages(printed: list[str]) -> list[str]:
    return [line.split("> ")[1] for line in printed if " > " in line]


def test_a_dry_run_accepts_the_finer_steps_of_some_aim_tti_supplies(setup: Any) -> None:
    fine = {"values_A": (0.0, 0.125), "start_A": None, "stop_A": None, "step_A": None}
    currents = setup.protocol.current.model_copy(update=fine)
    setup.protocol = setup.protocol.model_copy(update={"current": currents})
    assert any(line.startswith("duration") for line in tell(setup, "aim-tti", "TCPIP::192.168.0.5::9221::SOCKET"))
    with pytest.raises(InputError, match=r"the current at state 1 is 0\.125 A, but the supply"):
        tell(setup, "genesys", "TCPIP::192.168.0.5::8003::SOCKET")


def test_a_dry_run_prints_exactly_the_messages_of_a_run(setup: Any) -> None:
    printed = tell(setup, "korad", "/dev/ttyACM0")
    setup.camera.swing_s = 1e-9
    setup.run()
    sent = [message.decode() for message in setup.bench.supply._link.sent]
    commands = (
        "OUT",
        "ISET1:",
        "OCP",
        "OVP",
    )  # VSET1 is left out: its value depends on the stricter limits of the rig, which `open_bench` applies
    assert [message for message in messages(printed) if message.startswith(commands)] == [
        message for message in sent if message.startswith(commands)
    ]
    assert printed[0] == "short on small with rig bench: 4 states"
    assert "state 3: 0.3 A, 1.41 mT, 2 frames" in printed
    assert printed[-1].startswith("duration: ")


@pytest.mark.parametrize(
    ("address", "driver", "expected"),
    [
        ("TCPIP::192.168.0.5::5025::SOCKET#3", "keysight-e36312a", "CURR 0.300, (@3)"),
        ("TCPIP::192.168.0.5::5025::SOCKET#2", "rigol-dp800", ":INST:NSEL 2"),
        ("TCPIP::192.168.0.5::5025::SOCKET#2", "siglent-spd", "CH2:CURR 0.300"),
        ("TCPIP::192.168.0.5::5025::SOCKET#4", "rs-hmp", "INST:NSEL 4"),
        ("/dev/ttyUSB0#0", "genesys", "ADR 0"),
        ("/dev/ttyUSB0#30", "genesys", "ADR 30"),
        ("/dev/ttyUSB0", "genesys", "ADR 6"),
        ("/dev/ttyACM0#1", "korad", "ISET1:0.300"),
    ],
)
def test_the_messages_name_the_channel_of_the_rig(setup: Any, address: str, driver: str, expected: str) -> None:
    assert expected in messages(tell(setup, driver, address))


@pytest.mark.parametrize("driver", DIALECTS)
def test_a_dry_run_works_with_every_driver(setup: Any, driver: str) -> None:
    lines = tell(setup, driver, "somewhere")
    assert [line.split(": ")[0].split("  ")[-1] for line in lines if " stored: " in line] == [
        f"state {index} stored" for index in range(4)
    ]
    assert messages(lines)


def test_a_channel_that_the_supply_does_not_have_is_reported(setup: Any) -> None:
    with pytest.raises(
        InstrumentError, match="somewhere#4: there is no channel 4; rigol-dp800 has the channels 1 to 3"
    ):
        tell(setup, "rigol-dp800", "somewhere#4")


def test_a_dry_run_on_a_bipolar_supply_sends_currents_of_both_signs(setup: Any) -> None:
    text = setup.protocol.text.replace("start_A = 0.0", "start_A = -0.3")
    setup.protocol = parse(Protocol, text, "p")
    assert "CURR -0.30" in messages(tell(setup, "kepco-bop", "somewhere"))


@pytest.mark.parametrize("bipolar", [False, True])
def test_a_dry_run_with_a_driver_of_another_package_prints_no_messages(
    setup: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, bipolar: bool
) -> None:
    information = tmp_path / "some_lab-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: some-lab\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[eimi_drivers.supplies]\nours = some_lab_supply:Ours\n")
    (tmp_path / "some_lab_supply.py").write_text(f"""
from eimi_drivers.supplies.korad import KoradSupply

class Ours(KoradSupply):
    name = "ours"
    bipolar = {bipolar}
""")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "ours" in SUPPLIES
    if bipolar:
        setup.protocol = parse(Protocol, setup.protocol.text.replace("start_A = 0.0", "start_A = -0.3"), "p")
    lines = tell(setup, "ours", "USB0::1::2::3::INSTR#7")
    assert messages(lines) == []
    stand_in = "kepco-bop" if bipolar else "korad"
    assert (
        "messages to the supply: not shown, because the driver ours comes from another package and has no emulator "
        f"here; the times are those of a supply with the driver {stand_in}"
    ) in lines
    assert sum(" stored: " in line for line in lines) == len(setup.protocol.currents_A)
    assert lines[-1].startswith("duration: ")
    sys.modules.pop("some_lab_supply", None)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("frames_per_state = 2", "frames_per_state = 1000000000", "frames_per_state = 1000000000 should be less than"),
        ("step_A = 0.1\ntol", "step_A = 1e-9\ntol", "ramp.step_A = 1e-09 should be greater than"),
        ("start_A = 0.0\nstop_A = 0.3\nstep_A = 0.1", "values_A = [" + "0.1, " * 100_000 + "]", "at most 1000 values"),
        ("stop_A = 0.3\nstep_A = 0.1", "stop_A = 0.3\nstep_A = 1e-9", "gives more than 1000 states"),
    ],
)
def test_a_protocol_that_no_run_could_finish_is_refused_in_one_short_line(
    files: Path, run: Any, old: str, new: str, expected: str
) -> None:
    path = files / "protocol.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    status, message = run("acquire", path, "--specimen", files / "specimen.toml", "--rig", "virtual", "--dry-run")
    assert (status, message.count("\n")) == (2, 1)
    assert expected in message
    assert len(message) < 400


LONG = """
conditioning = { cycles = 3, current_A = 0.5 }
transients = { frames_per_state = 6 }
ring_down = { seconds = 2.0, repeats = 3, from_A = 0.4, rate_Hz = 60.0 }
"""
INTERLOCK = Interlock(reading="coil_voltage_V", maximum=8.0)


def long_run(setup: Any) -> tuple[list[str], list[str]]:
    # Return the steps and the details of the dry run of a protocol with ten states and every kind of step.
    setup.protocol = parse(Protocol, LONG + setup.protocol.text.replace("stop_A = 0.3", "stop_A = 0.9"), "p")
    setup.rig = setup.rig.model_copy(update={"interlocks": (INTERLOCK,)})
    steps: list[str] = []
    details: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, steps.append, details.append)
    return steps, details


def test_the_steps_of_a_long_run_are_summarised(setup: Any) -> None:
    steps, details = long_run(setup)
    worst = hottest(setup.protocol, setup.rig.coil)
    assert steps[:-2] == [
        "short on small with rig bench: 10 states",
        "limits of the supply: 1 A, 10 V; each ramp changes the current by 10 A/s",
        f"coil: heated to at most {100 * worst.share:.0f} % of the allowed heat, at the end of {worst.stage}",
        "interlock: coil_voltage_V at most 8, read at least every 5 s",
        "conditioning: 3 cycles to 0.5 A and back to 0",
        *[f"state {index}: {index / 10:g} A, {0.47 * index:.4g} mT, 2 frames" for index in range(6)],
        "… 2 states between …",
        *[f"state {index}: {index / 10:g} A, {0.47 * index:.4g} mT, 2 frames" for index in (8, 9)],
        "transients: at most 6 frames of each state while the beam settles",
        "ring-down: from 0.4 A to zero in one step, recorded for 2 s at 60 Hz, 3 times",
    ]
    assert steps[-2].startswith("only the run checks the interlocks (coil_voltage_V); ")
    between = [f"state {index}: {index / 10:g} A, {0.47 * index:.4g} mT, 2 frames" for index in (6, 7)]
    assert [line for line in details if line in between] == between
    assert details[2] == "messages to a supply with the driver korad:"
    printed: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, printed.append)
    assert not any("states between" in line for line in printed)
    untimed = re.compile(r"^ *\d+\.\d\d s  ")  # the simulated time of a message in a ring-down depends on the threads
    expected = [*(line for line in steps[:-1] if "between" not in line), *details]
    assert {untimed.sub("", line) for line in printed[:-1]} == {untimed.sub("", line) for line in expected}


def test_a_dry_run_prints_the_durations_with_a_beam_at_rest_and_with_a_beam_that_never_rests(setup: Any) -> None:
    # If the beam never rests, each wait takes 5 s and not 0.02 s: in ten states, in four frames of the conditioning,
    # and before three ring-downs.
    shortest_s, longest_s = durations_s(long_run(setup)[0][-1])
    assert shortest_s > 3 * 2.0  # of the ring-downs
    assert longest_s - shortest_s == pytest.approx((10 + 4 + 3) * (5.0 - 0.02), abs=1.0)


def durations_s(line: str) -> tuple[int, int]:
    found = re.fullmatch(r"duration: (\d+) s if the beam is at rest at once, (\d+) s if it never comes to rest", line)
    assert found is not None
    return int(found[1]), int(found[2])


@pytest.mark.parametrize(("dwell_s", "longer_s"), [(3.0, 4 * (5.0 - 3.0)), (8.0, 0.0)])
def test_a_wait_for_a_beam_that_never_rests_includes_the_shortest_duration_of_a_state(
    setup: Any, dwell_s: float, longer_s: float
) -> None:
    setup.protocol = parse(Protocol, setup.protocol.text.replace("[settle]", f"[settle]\ndwell_s = {dwell_s}"), "p")
    lines: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, lines.append)
    shortest_s, longest_s = durations_s(lines[-1])
    assert longest_s - shortest_s == pytest.approx(longer_s, abs=1.0)


def test_the_camera_of_a_dry_run_shows_a_beam_at_rest_with_noise() -> None:
    # The standard deviation of the noise is 2 grey levels.
    clock = SimulatedClock()
    camera = _BeamAtRest(clock)
    began_s = clock.now()
    frames = [camera.grab(1.0) for _ in range(30)]
    assert [frame.number for frame in frames] == list(range(1, 31))
    np.testing.assert_allclose([frame.timestamp_s for frame in frames], began_s + np.arange(1, 31) / 30)
    images = np.array([frame.image for frame in frames], dtype=float)
    assert images.shape[1:] == (32, 32)
    # Cutting the decimals off lowers the mean by a half.
    assert images[:, :, 12:20].mean() == pytest.approx(19.5, abs=0.1)
    assert images[:, :, [11, 20]].mean() == pytest.approx(199.5, abs=0.1)
    assert images.std(axis=0).mean() == pytest.approx(2.0, abs=0.1)
    assert camera.identify().text == "no camera"
