"""Recovery notices every damaged table, rebuilds what other tables contain, and leaves out only what is lost."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, SensorReading
from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.dataset.moving.motion_import import add_motions
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.rebuilding import rebuilt_tables
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.recovery import copy_readable
from eimi_lab.dataset.steps import RingDownStep, SetPoint
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError

STATES = 3
REST_MM = np.array([[5.0, 0.0], [10.0, 0.0]])
CREEP = Motion(
    kind="creep",
    points_mm=np.repeat(REST_MM[None], 4, axis=0),
    rest_mm=REST_MM,
    time_s=np.repeat(np.arange(1.0, 5.0)[:, None], 2, axis=1),
    sigma_mm=np.full((4, 2), 0.01),
)


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (24, 32)).astype(np.uint8)


@pytest.fixture
def finished(files: Path) -> Path:
    # A dataset of three states with two frames each, a sensor, and an imported creep.
    specimen = load_specimen(files / "specimen.toml")
    sensor = LoggedSensor("probe", "F41", "field", "mT")
    header = Header(specimen, load_calibration(files / "calibration.toml"), sensors=(sensor,))
    with DatasetWriter(files / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(STATES):
            frames = [Frame(image(2 * k + i), 2 * k + i, 0.1 * i) for i in (0, 1)]
            sensed = [{"probe": SensorReading(float(k), "mT", 2.0 * k + i)} for i in (0, 1)]
            times = [2.0 * k, 2.0 * k + 1.0]
            writer.append_state(frames, current_A=k / 10, field_mT=0.47 * k, time_s=times, sensed=sensed)
    add_motions(files / "run.h5", [CREEP], specimen)
    return files / "run.h5"


def recovered(path: Path, place: str, bits: tuple[int, ...], header: bool = False) -> list[str]:
    # Flip bits in the first chunk of an array, or in its header; recover the file to copy.h5, and return the lines.
    with h5py.File(path) as file:
        item = file[place].id
        at = h5py.h5o.get_info(item).addr + 20 if header else item.get_chunk_info(0).byte_offset
    raw = bytearray(path.read_bytes())
    for bit in bits:
        raw[at + bit // 8] ^= 1 << bit % 8
    path.write_bytes(raw)
    states, lines = copy_readable(path, path.with_name("copy.h5"))
    assert states == STATES
    return lines


@pytest.mark.parametrize("place", ["entry/data/time", "entry/creep_points/0/points"])
def test_a_flipped_bit_is_corrected_in_every_table(finished: Path, place: str) -> None:
    with h5py.File(finished) as file:
        before = file[place][()]
    assert recovered(finished, place, (5,)) == ["single flipped bits in the file that were corrected: 1"]
    with h5py.File(finished.with_name("copy.h5")) as file:
        np.testing.assert_array_equal(file[place][()], before)


@pytest.mark.parametrize("word", [b"NXlog", b"NXcollection"])
def test_a_damaged_description_of_a_group_costs_nothing_else(finished: Path, word: bytes) -> None:
    raw, copy = finished.read_bytes(), finished.with_name("copy.h5")
    places = [match.start() for match in re.finditer(word, raw)]
    assert places
    for at in places:
        damaged = bytearray(raw)
        damaged[at] ^= 0x80
        finished.write_bytes(damaged)
        states, (line,) = copy_readable(finished, copy)
        assert (states, line.startswith("unreadable and left out: attributes of /entry/")) == (STATES, True)
        with open_dataset(copy) as dataset:
            assert [state.field_mT for state in dataset.states] == pytest.approx([0.0, 1.0, 2.0])
            assert len(dataset.creeps()) == len(dataset.sensors()) == 1


@pytest.fixture
def with_ring_down(files: Path) -> Path:
    # A dataset of three states and one ring-down of six frames.
    header = Header(
        load_specimen(files / "specimen.toml"),
        load_calibration(files / "calibration.toml"),
        parse(Protocol, f"ring_down = {{ seconds = 0.5 }}\n{(files / 'protocol.toml').read_text()}", "protocol"),
    )
    with DatasetWriter(files / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(STATES):
            at = SetPoint(2.0 * k, k / 10, 0.01)
            frames = [Frame(image(k), k, 0.1)]
            writer.append_state(frames, current_A=k / 10, field_mT=0.47 * k, time_s=[2.0 * k], set_points=[at])
        add_ring_down(writer)
    return files / "run.h5"


def add_ring_down(writer: DatasetWriter) -> None:
    with writer.ring_down() as frames:
        for number in range(6):
            frames.put(image(100 + number))
    step = RingDownStep(0, 0.2, 0.0, 20.0, 0.001, 6, 0, 100.0)
    none = image(0)[:0]
    moments = [Moment(Frame(none, i, 0.01 * i), 20.0 + 0.01 * i, 0.01 * i, 0.0) for i in range(6)]
    writer.end_ring_down(step, moments, [SetPoint(20.0, 0.0, 0.001)])


def test_a_ring_down_without_its_frames_is_recorded_again(with_ring_down: Path) -> None:
    (line,) = recovered(with_ring_down, "entry/ring_down/elapsed", (2, 25))
    assert line == "unreadable and left out: entry/ring_down"
    copy = with_ring_down.with_name("copy.h5")
    with open_dataset(copy) as dataset:
        assert (dataset.stored_ring_downs, dataset.recorded_ring_downs()) == (0, ())
    with DatasetWriter.resume(copy) as writer:
        assert writer.ring_downs == 0
        add_ring_down(writer)
    with open_dataset(copy) as dataset:
        ((step, frames),) = dataset.recorded_ring_downs()
        assert (step.ring_down, len(frames)) == (0, 6)


def test_incomplete_rows_of_set_points_and_ring_downs_are_removed(with_ring_down: Path) -> None:
    with h5py.File(with_ring_down, "r+") as file:  # as after a crash between two columns
        file["entry/set_points/current"].resize(3, axis=0)
        for name, column in file["entry/ring_down_steps"].items():
            if name != "ring_down":
                column.resize(0, axis=0)
    copy = with_ring_down.with_name("copy.h5")
    copy_readable(with_ring_down, copy)
    with DatasetWriter.resume(copy) as writer:
        assert writer.ring_downs == 0
        writer.append_set_points([SetPoint(100.0, 0.1, 0.01)])
    with open_dataset(copy) as dataset:
        assert dataset.stored_ring_downs == 0
        points = [(point.time_s, point.current_A) for point in dataset.set_points()]
    assert points[:3] == [(0.0, 0.0), (2.0, 0.1), (4.0, 0.2)]
    assert points[-1] == (100.0, 0.1)


@pytest.mark.parametrize("header", [False, True])
@pytest.mark.parametrize(
    ("column", "words", "values"),
    [
        ("number", "lost; its values are unknown now", [-1] * 6),
        ("timestamp", "lost; its values are unknown now", [np.nan] * 6),
        ("time", "lost; its values are unknown now", [np.nan] * 6),
        ("set_current", "rebuilt from the states", [0.0, 0.0, 0.1, 0.1, 0.2, 0.2]),
        ("field", "rebuilt from the states", [0.0, 0.0, 0.47, 0.47, 0.94, 0.94]),
    ],
)
def test_a_damaged_column_of_the_frames_costs_no_state(
    finished: Path, column: str, words: str, values: list[float], header: bool
) -> None:
    (line,) = recovered(finished, f"entry/data/{column}", (2, 25), header)
    place = f"entry/data/{column} ({words})"
    assert line.startswith(f"unreadable and left out: {place}")
    with open_dataset(finished.with_name("copy.h5")) as dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 0.1, 0.2]
        np.testing.assert_array_equal(dataset.images(2), [image(4), image(5)])
        assert len(dataset.creeps()) == len(dataset.sensors()) == 1
    with h5py.File(finished.with_name("copy.h5")) as file:
        np.testing.assert_allclose(file[f"entry/data/{column}"][()], values)
        for name in ("set_current", "measured_current"):
            log = file[f"entry/instrument/supply/{name}"]
            assert (log["time"], log["value"]) == (file["entry/data/time"], file[f"entry/data/{name}"])


@pytest.mark.parametrize(
    ("place", "left_out"),
    [
        ("entry/creep_points/0/points", "entry/creep_points"),
        ("entry/sample/environment/probe/value_log/value", "entry/sample/environment/probe"),
    ],
)
def test_a_group_without_one_of_its_parts_is_left_out(finished: Path, place: str, left_out: str) -> None:
    assert recovered(finished, place, (2, 25)) == [f"unreadable and left out: {left_out}"]
    with open_dataset(finished.with_name("copy.h5")) as dataset:
        assert (len(dataset.creeps()), len(dataset.sensors())) == ((0, 1) if "creep" in place else (1, 0))


def test_lost_directions_of_tip_forces_are_not_invented(finished: Path) -> None:
    with (
        h5py.File(finished, "r+") as file,
        pytest.raises(InputError, match=r"run\.h5: the tip forces of its states are damaged; repeat the import"),
    ):
        rebuilt_tables(file["entry"], ["/entry/states/tip_force_angle"], finished)
