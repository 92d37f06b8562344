"""A run can be paused, ended during the pause, and paused again; the coil is off during each pause."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected
from eimi_lab.acquisition.events import (
    Event,
    OutputSwitched,
    Paused,
    PauseRequested,
    RingDownStored,
    StateStored,
)
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process import console
from eimi_lab.process.stopping import Stopped
from eimi_lab.process.writer_lock import only_writer
from tests.patience import PATIENCE_S
from tests.shared.changed_module import changed_module
from tests.shared.processes import wait_until

SWEEP = "start_A = 0.0\nstop_A = 0.3\nstep_A = 0.1"


def typist(setup: Any, paused_for: int) -> Callable[[], str | None]:
    # Return a replacement for a keyboard, on which a user pauses the run in the first state with a current.
    # paused_for: how many times the run reads the keyboard before the user ends the pause.
    looks: list[bool] = []

    def typed() -> str | None:
        if setup.coil.state.output:
            return "p" if setup.coil.state.set_current_A == 0.1 and not looks else None
        looks.append(setup.is_off())
        assert all(looks)
        return "" if len(looks) == paused_for else None

    return typed


def test_a_paused_run_switches_off_and_returns_through_the_same_currents(setup: Any) -> None:
    history: list[float] = []
    take = setup.coil.set_current
    setup.coil.set_current = lambda current_A: history.append(current_A) or take(current_A)
    remarks: list[str] = []
    messages = setup.run(typed=typist(setup, 600), remark=remarks.append)
    assert [line.split(",")[0] for line in messages] == ["0 A", "0.1 A", "0.2 A", "0.3 A"]
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert setup.is_off()
    assert remarks[0] == "the run will pause after the present state is stored"
    assert remarks[1] == (
        f"paused before state 2: the coil is off, and 2 of 4 states are in {setup.path}; "
        "Enter continues the run, Ctrl-C ends it"
    )
    assert len(remarks) == 3
    again = history.index(0.0, history.index(0.1))
    assert [value for value in history[again:] if value][:3] == [
        0.1,
        0.2,
        0.3,
    ]  # 0.1 A again, because the shape of the beam depends on the earlier currents
    with h5py.File(setup.path) as file:
        assert file["entry/sessions/first_state"][()].tolist() == [0, 2]
        time_s = file["entry/data/time"][()]
        assert np.diff(time_s).max() > 60.0


def test_a_paused_run_returns_through_every_earlier_state(setup: Any) -> None:
    # The largest current comes first. It may soften the beam, so that the beam must reach it again after the pause.
    setup.protocol = parse(Protocol, setup.protocol.text.replace(SWEEP, "values_A = [0.0, 0.3, 0.1, 0.2]"), "p")
    since_pause: list[float] = []
    take = setup.coil.set_current
    setup.coil.set_current = lambda current_A: since_pause.append(current_A) or take(current_A)
    looks: list[bool] = []

    def typed() -> str | None:
        if setup.coil.state.output:
            return "p" if setup.coil.state.set_current_A == 0.1 and len(setup.live) > 2 and not looks else None
        looks.append(True)
        since_pause.clear()
        return "" if len(looks) == 2 else None

    setup.live = []
    setup.run(typed=typed, remark=lambda words: None, show=lambda live: setup.live.append(live) if live.state else None)
    assert looks == [True] * 2
    assert [value for value in since_pause if value][:6] == pytest.approx([0.1, 0.2, 0.3, 0.2, 0.1, 0.2])
    assert setup.stored() == [0.0, 0.3, 0.1, 0.2]


class Keyboard:
    # A keyboard on which a user types lines at the events of a run, and ends each pause with the third look.

    def __init__(self, lines: Callable[[Event], list[str]]) -> None:
        self.lines, self.waiting, self.looks = lines, list[str](), 0
        self.waiting_in_pause: list[int] = []
        self.events: list[Event] = []

    def hear(self, event: Event) -> None:
        self.events.append(event)
        self.waiting.extend(self.lines(event))
        if isinstance(event, Paused):
            self.waiting_in_pause.append(len(self.waiting))

    def typed(self) -> str | None:
        if self.waiting:
            return self.waiting.pop()
        if not self.waiting_in_pause:
            return None
        self.looks += 1
        return "" if self.looks % 3 == 0 else None


def test_lines_that_were_typed_while_the_coil_was_switched_off_do_not_end_a_pause(setup: Any) -> None:
    def lines(event: Event) -> list[str]:
        if isinstance(event, OutputSwitched) and not event.on and not keyboard.waiting_in_pause:
            return ["", "p", ""]
        return ["p"] if isinstance(event, StateStored) and event.state == 0 else []

    keyboard = Keyboard(lines)
    setup.run(typed=keyboard.typed, on_event=keyboard.hear, remark=lambda words: None)
    assert keyboard.waiting_in_pause == [0]
    assert keyboard.looks >= 3
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


@pytest.mark.parametrize("ring_down", [True, False])
def test_a_pause_in_the_last_state_is_announced_only_before_ring_downs(setup: Any, ring_down: bool) -> None:
    if ring_down:
        setup.protocol = parse(Protocol, f"ring_down = {{ seconds = 0.1 }}\n{setup.protocol.text}", "p")
    keyboard = Keyboard(lambda event: ["p"] if isinstance(event, StateStored) and event.state == 2 else [])
    setup.run(typed=keyboard.typed, on_event=keyboard.hear, remark=lambda words: None)
    told = [type(event) for event in keyboard.events if isinstance(event, PauseRequested | Paused | RingDownStored)]
    assert told == [PauseRequested, Paused, RingDownStored] * ring_down
    if ring_down:
        with open_dataset(setup.path) as dataset:
            ((step, _),) = dataset.recorded_ring_downs()
        assert step.from_A == 0.3


def test_ctrl_d_on_a_terminal_is_no_typed_line(monkeypatch: pytest.MonkeyPatch) -> None:
    keys, terminal = os.openpty()
    in_front = changed_module(os, tcgetpgrp=lambda descriptor: os.getpgrp())
    monkeypatch.setattr(console, "os", in_front)
    monkeypatch.setattr(console, "sys", changed_module(sys, stdin=SimpleNamespace(fileno=lambda: terminal)))
    os.write(keys, b"\x04\nyes\n")
    typed: list[str] = []

    def both_lines() -> bool:
        line = console.typed_line()
        typed.extend([] if line is None else [line])
        return len(typed) == 2

    wait_until(both_lines, "both lines should be read")
    for end in (keys, terminal):
        os.close(end)
    assert typed == ["", "yes"]


def test_a_pause_can_be_ended_by_ctrl_c(setup: Any) -> None:
    typed = typist(setup, 10**9)

    def ask(seconds: float, sleep: Callable[[float], None] = setup.bench.clock.sleep) -> None:
        sleep(seconds)
        if not setup.coil.state.output and setup.camera.number > 20:
            signal.raise_signal(signal.SIGINT)

    setup.bench.clock.sleep = ask
    with pytest.raises(Stopped) as stopped:
        setup.run(typed=typed, remark=lambda words: None)
    assert str(stopped.value) == (
        f"stopped by SIGINT: the coil is off, the measured current is below 0.02 A; 2 of 4 states are in {setup.path}; "
        "the same command with --resume continues the run"
    )
    del setup.bench.clock.sleep
    setup.run(resume=True)
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_ctrl_c_before_the_first_state_leaves_no_file_and_says_so(setup: Any) -> None:
    setup.camera.event = lambda number: signal.raise_signal(signal.SIGINT) if number == 9 else None
    with pytest.raises(
        Stopped,
        match=r"the coil is off, the measured current is below 0\.02 A; no state was stored, so there is no file",
    ):
        setup.run()
    assert not setup.path.exists()


def unfinished(setup: Any) -> None:
    def fail(number: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = fail
    with pytest.raises(InstrumentDisconnected):
        setup.run(remark=lambda words: None)


def test_a_rerun_on_an_unfinished_file_proposes_to_resume_it(setup: Any, run: Any) -> None:
    unfinished(setup)
    folder = setup.path.parent
    command = ("acquire", folder / "protocol.toml", "--specimen", folder / "specimen.toml", "--rig", "virtual", "-o")
    status, message = run(*command, setup.path)
    assert (status, message.count("\n")) == (2, 1)
    assert "run.h5: holds 2 of the 4 states of a run that ended early; --resume continues this run" in message
    assert "--force" not in message
    (folder / "other.h5").write_text("something else")
    assert "other.h5: exists already" in run(*command, folder / "other.h5")[1]


def test_a_rerun_on_a_file_in_use_proposes_neither_to_resume_nor_to_replace_it(setup: Any) -> None:
    unfinished(setup)
    other = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
    with only_writer(setup.path):
        done = subprocess.run(
            [*other, "--rig", "virtual", "-o", "run.h5"],
            cwd=setup.path.parent,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
    assert done.returncode == 2
    assert "run.h5: is being written to by process" in done.stderr
    assert "--force" not in done.stderr


def test_p_and_enter_on_a_terminal_pause_a_run(bench: Path) -> None:
    coil = CoilSupply(WallClock())
    keys, terminal = os.openpty()
    os.write(keys, b"p\n")  # the run reads it in its first state

    def own_terminal() -> None:
        fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)

    with serve_tcp(emulate("scpi", coil)) as address:
        (bench / "rig.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ driver = "scpi", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = "{bench / "recording"}" }}
""")
        command = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
        process = subprocess.Popen(
            [*command, "--rig", "rig.toml", "-o", "run.h5"],
            cwd=bench,
            stdin=terminal,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=own_terminal,
        )
        os.close(terminal)
        assert process.stderr is not None
        messages, off = [], []
        for line in process.stderr:
            messages.append(line.rstrip())
            if line.startswith("eimi: paused before state "):
                WallClock().sleep(6.0 if not off else 0.0)  # longer than the guardian waits for a run that stands still
                off.append(not coil.state.output and coil.state.set_current_A == 0.0)
                os.write(keys, b"\n")
        process.stderr.close()
        assert process.wait(PATIENCE_S) == 0, messages
    os.close(keys)
    assert off == [True]
    assert "eimi: press p and Enter to pause the run with the coil off; press Ctrl-C to end the run" in messages[:2]
    assert "eimi: the run continues; the current first passes through the set-points of the previous states" in messages
    assert not coil.state.output
    with open_dataset(bench / "run.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 0.1, 0.2, 0.3]
