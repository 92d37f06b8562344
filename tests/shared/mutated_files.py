"""Change datasets, images and other files at random; each must be read or refused with an error of one line."""

from __future__ import annotations

import collections
import multiprocessing
import os
import resource
import shutil
import signal
import tempfile
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import locate
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.recovery import MEMORY_BYTES, copy_readable
from eimi_lab.dataset.tracked.c3d import bound_memory, read_c3d, read_in_this_process
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.fits.fits_file import Fits, read_fits_file
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window
from eimi_lab.process.errors import InputError
from eimi_lab.process.limits import limit_memory
from eimi_lab.vision.image_files import read_image

WITHIN_S = 10.0
"""Largest processor time (s) for one file."""
STUCK_AFTER_S = 600.0
"""Time (s) after which a process that does not answer, but computes nothing, is replaced."""
READERS = {
    ".h5": "dataset",
    "protocol.toml": "protocol",
    "specimen.toml": "specimen",
    "rig.toml": "rig",
    "calibration.toml": "calibration",
    ".json": "fits",
    ".csv": "tensile",
    ".png": "image",
    ".jpg": "image",
    ".tif": "image",
    ".bmp": "image",
    ".pgm": "image",
    ".c3d": "motion capture",
}


def sources(folder: Path) -> list[Path]:
    """Write valid files of every kind into a folder, and return their paths."""
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"), load_protocol("dragon_skin_10"))
    random = np.random.default_rng(0)
    with DatasetWriter(folder / "finished.h5", header, Frame(np.zeros((24, 32), np.uint8), 0, 0.0)) as writer:
        for state in range(3):
            frames = [Frame(random.integers(0, 99, (24, 32)).astype(np.uint8), k, 0.0) for k in range(2)]
            writer.append_state(
                frames,
                current_A=0.1 * state,
                field_mT=0.47 * state,
                measured_A=[0.1 * state] * 2,
                transient=[Moment(frames[0], 0.0, 0.1, 0.1 * state)],
            )
        shutil.copyfile(folder / "finished.h5", folder / "crashed.h5")
    for name, shipped in (
        ("protocol", locate("dragon_skin_10")),
        ("specimen", locate("type1", "specimens")),
        ("rig", locate("bench_example", "rigs")),
        ("calibration", locate("virtual_calibration", "rigs")),
    ):
        shutil.copyfile(shipped, folder / f"{name}.toml")
    shutil.copyfile(locate("bench_example_calibration", "rigs"), folder / "bench_example_calibration.toml")
    configured = [folder / name for name in ("finished.h5", "crashed.h5", *list(READERS)[1:5])]
    return [*configured, *_tables_and_pictures(folder), *_motion_capture(folder)]


def _tables_and_pictures(folder: Path) -> list[Path]:
    """Write a tensile curve, a fit of this curve, and a picture in each image format; return their paths."""
    rows = [f"{0.05 * k},{0.012 * k}" for k in range(1, 30)]
    (folder / "curve.csv").write_text("\n".join(["strain,stress_MPa", *rows]) + "\n")
    Fits.of([fit_window(read_tensile(folder / "curve.csv"), "neo-hookean", None)]).write(folder / "fits.json")
    image = np.random.default_rng(1).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    pictures = [folder / f"picture{ending}" for ending in (".png", ".jpg", ".tif", ".bmp", ".pgm")]
    for picture in pictures:
        cv2.imwrite(str(picture), image[..., 0] if picture.suffix == ".pgm" else image)
    return [folder / "curve.csv", folder / "fits.json", *pictures]


def _motion_capture(folder: Path) -> list[Path]:
    """Write a C3D file with four markers; return its path in a list, which is empty without the package for C3D."""
    if find_spec("ezc3d") is None:
        return []
    import ezc3d

    capture = ezc3d.c3d()
    capture["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    capture["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    capture["parameters"]["POINT"]["LABELS"]["value"] = ("root", "middle", "tip", "lost")
    capture["data"]["points"] = np.random.default_rng(2).uniform(0.0, 500.0, (4, 4, 3))
    capture.write(str(folder / "capture.c3d"))
    return [folder / "capture.c3d"]


def mutated(raw: bytes, random: np.random.Generator) -> bytes:
    """Return a copy of the bytes `raw` with one to four random changes."""
    changed = bytearray(raw)
    for _ in range(int(random.integers(1, 5))):
        at = int(random.integers(0, max(len(changed), 1)))
        match int(random.integers(0, 6)):
            case 0 if changed:
                changed[at] ^= 1 << int(random.integers(0, 8))
            case 1 if changed:
                changed[at] = int(random.integers(0, 256))
            case 2:
                changed[at : at + 8] = int(random.choice([0, 1, 2**31, 2**63 - 1, 10**15])).to_bytes(8, "little")
            case 3:
                changed[at : at + int(random.integers(1, 64))] = bytes(int(random.integers(0, 64)))
            case 4:
                other = int(random.integers(0, max(len(changed), 1)))
                changed[at : at + 16] = changed[other : other + 16]
            case 5 if random.random() < 0.2:
                del changed[at:]
    return bytes(changed)


def recovered(path: Path) -> str:
    # Recover a dataset; return "read", "refused", or "refused in several lines" (of a message, which should have one).
    try:
        copy_readable(path, path.with_name("copy.h5"))
    except InputError as error:
        return "refused" if "\n" not in str(error) else "refused in several lines"
    with open_dataset(path.with_name("copy.h5")) as dataset:
        for state in dataset.states:
            dataset.images(state.index), dataset.transient(state.index)
    return "read"


def read(path: Path) -> str:
    # Read a file completely; return "read", "refused", or "refused in several lines" (of a message).
    try:
        match next(kind for ending, kind in READERS.items() if path.name.endswith(ending)):
            case "dataset":
                with open_dataset(path) as dataset:
                    for state in dataset.states:
                        dataset.images(state.index), dataset.transient(state.index)
                    dataset.instruments(), dataset.start_time(), dataset.edges(), dataset.correction(), dataset.truth()
            case "protocol":
                load_protocol(path)
            case "specimen":
                load_specimen(path)
            case "rig":
                load_rig(path)
            case "fits":
                read_fits_file(path)
            case "tensile":
                read_tensile(path)
            case "image":
                read_image(path)
            case "motion capture":
                before = resource.getrlimit(resource.RLIMIT_AS)
                bound_memory(path.stat().st_size)
                try:
                    read_in_this_process(path)
                finally:  # a dataset is checked in a child process, which a process with little memory cannot start
                    resource.setrlimit(resource.RLIMIT_AS, before)
            case _:
                load_calibration(path)
    except MemoryError:
        if path.suffix != ".c3d":
            raise
        return "refused"
    except InputError as error:
        return "refused" if "\n" not in str(error) else "refused in several lines"
    return "read"


def serve(pipe: Connection, recover: bool) -> None:
    """Read (or recover) each file whose path arrives in the pipe, and send back outcome and printed words.

    None in the pipe ends the function.
    """
    if recover:
        limit_memory(MEMORY_BYTES)
    with tempfile.TemporaryFile() as printed:
        for descriptor in (1, 2):
            os.dup2(printed.fileno(), descriptor)
        while (path := pipe.recv()) is not None:
            signal.setitimer(signal.ITIMER_PROF, WITHIN_S)  # the signal of this timer ends the process in any situation
            try:
                outcome, words = recovered(path) if recover else read(path), ""
            except Exception as error:
                outcome, words = "traceback", f"{type(error).__name__}: {error}"
            if size := printed.seek(0, os.SEEK_END):
                printed.seek(0)
                outcome, words = f"{outcome} with words printed", str(printed.read(size))
                printed.seek(0)
                printed.truncate()
            pipe.send((outcome, words))


def read_guarded(path: Path) -> str:
    # Try to read a C3D file; return "read", "refused", or "refused in several lines" (of a message).
    try:
        read_c3d(path)
    except InputError as error:
        return "refused" if "\n" not in str(error) else "refused in several lines"
    return "read"


def fuzz(files: int, seed: int, recover: bool = False) -> collections.Counter[str]:
    """Change `files` valid files at random, read or recover them, and return the number of files by outcome."""
    counts: collections.Counter[str] = collections.Counter()
    random = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        originals = [(path, path.read_bytes()) for path in sources(Path(name))]
        if recover:
            originals = [(path, raw) for path, raw in originals if path.suffix == ".h5"]
        process = pipe = None
        for number in range(files):
            if process is None or pipe is None:
                pipe, far = multiprocessing.Pipe()
                process = multiprocessing.get_context("fork").Process(target=serve, args=(far, recover), daemon=True)
                process.start()
                far.close()
            path, raw = originals[int(random.integers(0, len(originals)))]
            path.write_bytes(mutated(raw, random))
            pipe.send(path)
            outcome, message = "hang", ""
            if pipe.poll(STUCK_AFTER_S):
                try:
                    outcome, message = pipe.recv()
                except EOFError:
                    process.join()
                    outcome = "hang" if process.exitcode == -signal.SIGPROF else "died"
            if outcome in ("hang", "died"):
                process.kill()
                process.join()
                process = None
                if path.suffix == ".c3d":
                    outcome = read_guarded(path)
            counts[outcome] += 1
            if outcome not in ("read", "refused"):
                print(f"file {number}, seed {seed}, {path.name}: {outcome} {message}", flush=True)
        if process is not None and pipe is not None:
            pipe.send(None)
            process.join()
    return counts
