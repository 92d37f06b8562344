"""After every single write of a run the dataset is readable, as after a power cut."""

# A library that is preloaded into the writer traces the writes below HDF5. The test rebuilds the file from this trace.

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from eimi_lab.dataset import opened_file
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.repair.probing import read_all_but_frames
from tests.patience import PATIENCE_S

COMPILER = shutil.which("cc")
SHAPE = (24, 32)

WRITE = f"""
import os, sys
from pathlib import Path
import numpy as np
from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.protocol import load_protocol
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.writing import DatasetWriter

folder, states, frames = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
header = Header(load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml"),
                load_protocol(folder / "protocol.toml"))
image = lambda k: np.random.default_rng(k).integers(0, 255, {SHAPE}).astype(np.uint8)
with DatasetWriter(folder / "run.h5", header, Frame(image(0), 0, 0.0)) as writer:
    trace = os.open(os.environ["TRACE"], os.O_WRONLY | os.O_APPEND)
    for k in range(states):
        taken = [Frame(image(k), n, 0.0) for n in range(frames)]
        writer.append_state(taken, current_A=k / 10, field_mT=k * 0.47, transient=[Moment(taken[0], 1.0, 0.5, k / 10)])
        os.write(trace, b"A" + bytes(16))
"""


def records(trace: bytes) -> Iterator[tuple[str, int, bytes]]:
    # Yield kind, offset and bytes of each record in a trace of writes; a record "A" marks a stored state.
    at = 0
    while at < len(trace):
        offset, length = struct.unpack_from("<qq", trace, at + 1)
        yield chr(trace[at]), offset, trace[at + 17 : at + 17 + length]
        at += 17 + length


@pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="needs a C compiler, on Linux")
@pytest.mark.parametrize(
    ("states", "frames"),
    [(1, 1), (3, 2), pytest.param(40, 3, marks=pytest.mark.slow)],
)
def test_at_every_write_boundary_each_acknowledged_state_can_be_read(
    files: Path, monkeypatch: pytest.MonkeyPatch, states: int, frames: int
) -> None:
    # The check of a file that was never closed, here in the same process, because there are thousands of files.
    monkeypatch.setattr(opened_file, "why_unreadable", lambda path: read_all_but_frames(path) or "")
    library, source = files / "traced_writes.so", Path(__file__).with_name("traced_writes.c")
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True, timeout=PATIENCE_S
    )
    traced = {"LD_PRELOAD": str(library), "TRACED": str(files / "run.h5"), "TRACE": str(files / "trace")}
    command = [sys.executable, "-c", WRITE, str(files), str(states), str(frames)]
    subprocess.run(command, env=os.environ | traced, check=True, timeout=PATIENCE_S)

    built, rebuilt = bytearray(), files / "rebuilt.h5"
    acknowledged = boundaries = 0
    for letter, offset, data in records((files / "trace").read_bytes()):
        match letter:
            case "A":
                acknowledged += 1
                continue
            case "B":
                built[:] = data
            case "T":
                built[offset:] = bytes(max(0, offset - len(built)))
            case "W":
                built.extend(bytes(max(0, offset - len(built))))
                built[offset : offset + len(data)] = data
        rebuilt.write_bytes(built)
        boundaries += 1
        with open_dataset(rebuilt) as dataset:
            assert len(dataset.states) >= acknowledged, f"boundary {boundaries}"
            assert [state.current_A for state in dataset.states] == [k / 10 for k in range(len(dataset.states))]
            for k in range(len(dataset.states)) if states < 10 else range(max(0, acknowledged - 1), acknowledged):
                expected = np.random.default_rng(k).integers(0, 255, SHAPE).astype(np.uint8)
                assert np.array_equal(dataset.images(k), np.stack([expected] * frames))
                transient = dataset.transient(k)
                assert transient is not None
                assert np.array_equal(transient.images, expected[None])
    assert acknowledged == states
    assert boundaries > 20 * states
    assert bytes(built) == (files / "run.h5").read_bytes()
    print(f"{boundaries} write boundaries, {states} states")
