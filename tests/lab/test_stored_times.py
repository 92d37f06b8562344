"""Every stored time counts from the beginning of the run, whatever clock the instruments use."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import InstrumentDisconnected
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from tests.lab.conftest import BEGAN_S
from tests.lab.test_sensing import HALL, ROOM, Emulated

EVERYTHING = "creep = true\nconditioning = { cycles = 2, current_A = 0.3 }\ntransients = { frames_per_state = 4 }\n"


def times_in(setup: Any) -> dict[str, np.ndarray]:
    # Return the columns of times (s) in the file of a run, by their paths.
    columns: dict[str, np.ndarray] = {}

    def collect(name: str, item: Any) -> None:
        if name.rpartition("/")[2] == "time" and item.attrs.get("units") == "s":
            columns[name.removeprefix("entry/")] = item[()]

    with h5py.File(setup.path) as file:
        file.visititems(collect)
    return columns


def test_all_times_lie_within_the_run(setup: Any) -> None:
    setup.protocol = parse(Protocol, EVERYTHING + setup.protocol.text, "p")
    Emulated(setup, HALL, ROOM)
    clock = setup.bench.clock
    setup.run(remark=lambda words: None)
    lasted_s = clock.now() - BEGAN_S
    columns = times_in(setup)
    assert {"data/time", "conditioning/time", "transients/time", "set_points/time"} <= columns.keys()
    assert sum("environment" in name for name in columns) == 2
    for name, times_s in columns.items():
        assert len(times_s), name
        assert times_s.min() >= 0.0, name
        assert times_s.max() <= lasted_s, name
        assert (np.diff(times_s) >= 0).all(), name
    # The conditioning ends before the first state, and the current of a state is set before its frames are taken.
    assert columns["conditioning/time"].max() < columns["data/time"].min()
    with h5py.File(setup.path) as file:
        set_A = file["entry/data/set_current"][()]
        sent_A = file["entry/set_points/current"][()]
    for current_A in (0.1, 0.2, 0.3):
        last_sent_s = columns["set_points/time"][np.isclose(sent_A, current_A)].max()
        assert last_sent_s < columns["data/time"][np.isclose(set_A, current_A)].min()


def test_the_time_of_a_resumed_run_goes_on_from_its_last_frame(setup: Any) -> None:
    def fail(number: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = fail
    with pytest.raises(InstrumentDisconnected):
        setup.run(remark=lambda words: None)
    before_s = times_in(setup)["data/time"]
    setup.camera.event = lambda number: None
    setup.bench.clock.sleep(500.0)
    resumed_s = setup.bench.clock.now()
    setup.run(resume=True, remark=lambda words: None)
    times_s = times_in(setup)["data/time"]
    assert times_s[: len(before_s)].tolist() == before_s.tolist()
    assert (np.diff(times_s) > 0).all()
    assert times_s[-1] - times_s[len(before_s)] < setup.bench.clock.now() - resumed_s
