"""Fits of several laws and seeds have the same result with any number of worker processes, also if some are killed."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import Load, TrackedPoints, write_points
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fit_grid import fit_grid, grid
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.workers import cluster, completed, executor_for, processes
from tests.patience import PATIENCE_S

Run = Callable[..., tuple[int, str]]

MODULUS_PA = 46e3
FIELD_MT = (0.0, 2.0, 4.0, 6.0, 8.0)
NOISE_MM = 0.01
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def beams(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A folder with two datasets of one beam of known modulus, with different noise.
    folder = tmp_path_factory.mktemp("beams")
    text = load_specimen("type1").text.replace(
        'section = "solid"', 'section = "plane-stress"'
    )  # plane stress is faster than a solid
    specimen = parse(SpecimenFile, text, "type1")
    model, loads = BeamModel(specimen.mechanics(), 20, 2), Loads.along(FIELD_MT)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[MODULUS_PA]]), loads)
    x, y = np.meshgrid(np.linspace(2, 24, 6), [-1.0, 1.0])
    rest = np.column_stack([x.ravel(), y.ravel()])
    names = tuple(f"p{i}" for i in range(len(rest)))
    for seed, name in enumerate(("first.h5", "second.h5")):
        rng = np.random.default_rng(seed)
        moved = model.positions(shapes, rest)[0] + rng.normal(0, NOISE_MM, (len(FIELD_MT), *rest.shape))
        write_points(
            folder / name,
            Header(specimen),
            0.0,
            [Load(None, field, 0.0) for field in FIELD_MT],
            [TrackedPoints(names, rest, place, np.full(len(rest), NOISE_MM)) for place in moved],
        )
    return folder


def without_times(content: Any) -> Any:
    # Return the content of fits.json without the durations of the fits.
    if isinstance(content, dict):
        return {key: without_times(value) for key, value in content.items() if key != "wall_s"}
    return [without_times(value) for value in content] if isinstance(content, list) else content


def read(path: Path) -> Any:
    return without_times(json.loads(path.read_text()))


def plain(fits: list[FitRecord]) -> Any:
    return without_times([fit.content() for fit in fits])


def test_a_grid_is_the_same_with_one_and_with_two_workers(beams: Path, tmp_path: Path, run: Run) -> None:
    fit = ["fit", beams / "first.h5", "--model", "neo-hookean", "--seed", "2", "--bootstrap", "1"]
    status, message = run(*fit, "-o", tmp_path / "one.json")
    assert status == 0, message
    status, message = run(*fit, "--workers", "2", "-o", tmp_path / "two.json")
    assert status == 0, message
    assert "fit 2/2: " in message
    assert read(tmp_path / "one.json") == read(tmp_path / "two.json")
    (fitted,) = read_fits_file(tmp_path / "two.json").fits
    assert (Path(fitted.datasets[0].path).name, fitted.seed) == ("first.h5", 2)
    assert fitted.initial_shear_modulus.value == pytest.approx(MODULUS_PA, rel=0.01)
    assert fitted.bootstrap is not None
    (replicate,) = fitted.bootstrap.replicates
    assert replicate.replicate == 1
    assert fitted.bootstrap.initial_shear_modulus_interval_95_Pa is None  # one replicate gives no bootstrap interval
    assert replicate.initial_shear_modulus_Pa == pytest.approx(MODULUS_PA, rel=0.02)
    assert replicate.initial_shear_modulus_Pa != fitted.initial_shear_modulus.value


def test_a_grid_is_ordered_by_dataset_then_seed_then_replicate(beams: Path) -> None:
    evidence = [load_evidence(beams / name) for name in ("first.h5", "second.h5")]
    tasks = grid(["yeoh", "ogden"], evidence, [1, 2], each=True, bootstrap=1)
    assert [(task.evidence, task.model, task.seed, task.replicate) for task in tasks] == [
        ((one,), model, seed, replicate)
        for one in evidence
        for model in ("yeoh", "ogden")
        for seed in (1, 2)
        for replicate in (0, 1)
    ]
    assert [task.evidence for task in grid(["yeoh"], evidence, [1])] == [tuple(evidence)]


@pytest.mark.slow
def test_the_bootstrap_interval_contains_the_modulus(beams: Path) -> None:
    tasks = grid(["neo-hookean"], [load_evidence(beams / "first.h5")], [1], bootstrap=40)
    (fit,) = fit_grid(tasks, {}, executor=partial(processes, 2))
    assert fit.bootstrap is not None
    assert fit.bootstrap.initial_shear_modulus_interval_95_Pa is not None
    low, high = fit.bootstrap.initial_shear_modulus_interval_95_Pa
    assert low < fit.initial_shear_modulus.value < high
    # 60 points in 5 states with 10 µm of noise determine the modulus to a few parts in a thousand.
    assert 1e-4 < (high - low) / MODULUS_PA < 0.02


def test_a_killed_worker_changes_nothing(beams: Path) -> None:
    tasks = grid(["neo-hookean"], [load_evidence(beams / "first.h5")], [1, 2])
    killed = []
    # Other tests in this process may have processes of their own, such as the worker of the page.
    others = set(multiprocessing.active_children())

    def kill_one(words: str) -> None:
        if not killed:
            killed.append(next(child for child in multiprocessing.active_children() if child not in others))
            killed[0].kill()

    whole = fit_grid(tasks, {})
    assert [fit.seed for fit in whole] == [1, 2]
    assert plain(fit_grid(tasks, {}, executor=partial(processes, 2), report=kill_one)) == plain(whole)
    assert killed
    assert killed[0].exitcode == -signal.SIGKILL
    assert set(multiprocessing.active_children()) <= others


def test_a_refusal_is_the_same_with_workers_and_without(beams: Path, tmp_path: Path, run: Run) -> None:
    (tmp_path / "odd.h5").write_bytes((beams / "first.h5").read_bytes())
    with h5py.File(tmp_path / "odd.h5", "r+", libver="latest") as file:
        file["entry/data/y"][...] = -file["entry/data/y"][()]  # the beam bends to the wrong side
    fit = ["fit", tmp_path / "odd.h5", "--model", "neo-hookean", "--model", "yeoh", "-o", tmp_path / "fits.json"]
    messages = [run(*fit, "--workers", workers) for workers in (1, 2)]
    assert messages[0][0] == messages[1][0] == 2
    assert "no material explains the measured shape of the beam" in messages[0][1]
    assert messages[0][1].split("\n")[-2] == messages[1][1].split("\n")[-2]
    assert not (tmp_path / "fits.json").exists()


def test_a_grid_ends_if_its_workers_always_die() -> None:
    with pytest.raises(ChildProcessError, match="lost 3 times in succession"):
        list(completed(os._exit, lambda task: {"status": 1}, [0, 1], partial(processes, 2)))


@pytest.fixture
def dask() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    # Start a local Dask scheduler with two workers; yield its address and the worker processes.
    pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'eimi-lab[cluster]'")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": ONE_THREAD}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", address]
    started = [subprocess.Popen(command, **quiet)]
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address]
    options = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
    started += [subprocess.Popen([*command, *options], **quiet) for _ in range(2)]
    try:
        from distributed import Client

        with Client(address, timeout=PATIENCE_S) as client:
            client.wait_for_workers(2, timeout=PATIENCE_S)
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same(
    beams: Path, dask: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = dask
    tasks = grid(["neo-hookean"], [load_evidence(beams / "first.h5")], [1, 2, 3], bootstrap=1)
    reported: list[str] = []

    def kill_one(words: str) -> None:
        reported.append(words)
        if len(reported) == 2:
            workers[0].kill()

    fits = fit_grid(tasks, {}, executor=partial(cluster, address), report=kill_one)
    assert len(reported) == len(tasks) == 6
    assert workers[0].wait(PATIENCE_S) == -signal.SIGKILL
    assert plain(fits) == plain(fit_grid(tasks, {}, executor=partial(processes, 2)))


def eimi(*arguments: object, cwd: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "eimi_lab", *map(str, arguments)]
    return subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def generations(path: Path) -> int:
    return path.read_bytes().count(b'"generation":') if path.exists() else 0


@pytest.mark.parametrize(("workers", "number"), [(1, signal.SIGTERM), (2, signal.SIGINT)])
def test_a_stopped_fit_prints_one_line_and_ends_its_workers(
    beams: Path, tmp_path: Path, workers: int, number: signal.Signals
) -> None:
    fit = ["fit", beams / "first.h5", "--model", "ogden", "--seed", 1, "--seed", 2, "--restarts", 5]
    fit += ["--workers", workers, "--checkpoint", "log.jsonl", "-o", "fits.json"]
    process = subprocess.Popen(
        [sys.executable, "-m", "eimi_lab", *map(str, fit)],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(
            signal.SIGINT, signal.SIG_DFL
        ),  # a test that runs in the background ignores this signal
    )
    while process.poll() is None and generations(tmp_path / "log.jsonl") < 1:
        time.sleep(0.002)
    os.killpg(process.pid, number)
    message = process.communicate(timeout=PATIENCE_S)[1]  # reads until the last process of the fit has ended
    go_on = "log.jsonl contains all generations so far; the same command with --resume continues the fit"
    assert (process.returncode, message.decode()) == (128 + number, f"eimi: stopped by {number.name}: {go_on}\n")
    assert not (tmp_path / "fits.json").exists()


@pytest.mark.parametrize(("checkpoint", "expected"), [([], "fits.json"), (["--checkpoint", "log.jsonl"], "log.jsonl")])
def test_a_full_disk_is_reported_in_one_line_with_the_file(
    beams: Path, tmp_path: Path, checkpoint: list[str], expected: str
) -> None:
    fit = ["fit", str(beams / "first.h5"), "--model", "neo-hookean", "--restarts", "1", *checkpoint, "-o", "fits.json"]
    done = subprocess.run(
        [sys.executable, "-m", "eimi_lab", *fit],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(
            resource.RLIMIT_FSIZE, (1024, 1024)
        ),  # largest size of every file, to imitate a full disk
    )
    assert (done.returncode, done.stderr.splitlines()[-1]) == (1, f"eimi: [Errno 27] File too large: '{expected}'")
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == checkpoint[1:]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_fit_that_is_killed_repeatedly_ends_with_the_same_result(beams: Path, tmp_path: Path, workers: int) -> None:
    fit = ["fit", beams / "first.h5", "--model", "neo-hookean", "--seed", 1, "--seed", 2, "--restarts", 1, "--bipop"]
    fit += ["--workers", workers, "--resume"]
    whole = eimi(*fit, "-o", "whole.json", "--checkpoint", "whole.jsonl", cwd=tmp_path)
    assert whole.wait(PATIENCE_S) == 0, whole.stderr
    log = tmp_path / "log.jsonl"
    kills = 0
    for target in (1, 8, 20, 30):
        process = eimi(*fit, "-o", "fits.json", "--checkpoint", "log.jsonl", cwd=tmp_path)
        while process.poll() is None and generations(log) < target:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        kills += process.wait(PATIENCE_S) == -signal.SIGKILL
        if kills == 2:  # the third attempt has to find a line that was cut off
            log.write_bytes(log.read_bytes()[:-40])
    assert kills >= 3
    assert not (tmp_path / "fits.json").exists()
    last = eimi(*fit, "-o", "fits.json", "--checkpoint", "log.jsonl", cwd=tmp_path)
    assert last.wait(PATIENCE_S) == 0, last.stderr
    assert read(tmp_path / "fits.json") == read(tmp_path / "whole.json")
    # Except for the order of the lines, both logs contain the same generations with the same objectives.
    logged = [
        {line for line in path.read_text().split("\n") if '"objective_mm":' in line and line.endswith("}}")}
        for path in (log, tmp_path / "whole.jsonl")
    ]
    assert logged[0] == logged[1]
    # A finished fit is not computed again.
    (tmp_path / "fits.json").unlink()
    size = log.stat().st_size
    assert eimi(*fit, "-o", "fits.json", "--checkpoint", "log.jsonl", cwd=tmp_path).wait(PATIENCE_S) == 0
    assert log.stat().st_size == size
    assert read(tmp_path / "fits.json") == read(tmp_path / "whole.json")


def test_a_checkpoint_that_cannot_be_resumed_is_refused_in_one_line(beams: Path, tmp_path: Path, run: Run) -> None:
    log, output = tmp_path / "log.jsonl", tmp_path / "fits.json"
    fit = ["fit", beams / "first.h5", "--model", "neo-hookean", "--restarts", 1, "-o", output, "--checkpoint", log]
    assert run(*fit)[0] == 0
    output.unlink()
    written = log.read_text()

    def refused(*more: object) -> str:
        status, message = run(*fit, *more)
        assert (status, message.count("\n")) == (2, 1), message
        assert not output.exists()
        return message

    assert "log.jsonl: exists already; give --resume to continue it" in refused()
    assert "to resume, restarts should be the same: 1 in the checkpoint, 2 here" in refused("--resume", "--restarts", 2)
    assert "fits should be the same" in refused("--resume", "--seed", 2)
    assert "--workers 2: the cluster" in refused("--resume", "--workers", 2, "--scheduler", "tcp://localhost:1")
    assert "second.h5" in refused("--resume", beams / "second.h5")
    log.write_text(written.replace('"numpy":"', '"numpy":"0.'))
    assert "version of numpy should be the same" in refused("--resume")
    log.write_text(written.replace('"step_size":0.', '"step_size":1.').rsplit("\n", 1)[0])
    assert "the fit cannot be continued from this file: generation 1 of the search differs" in refused("--resume")
    log.write_text(written.replace('"generation":3', '"generation":"x"'))
    assert "complete line 4: generation" in refused("--resume")
    log.write_text(written.replace('"fit":0', '"fit":1'))
    assert "complete line 2: fit = 1 should be from 0 to 0" in refused("--resume")
    log.unlink()
    log.symlink_to("none/log.jsonl")
    assert "log.jsonl: there is no folder" in refused()
    log.unlink()
    log.write_text("something else")
    assert "log.jsonl: is not a checkpoint of `eimi fit`" in refused("--resume")
    status, message = run("fit", beams / "first.h5", "--model", "neo-hookean", "-o", output, "--resume")
    assert (status, message) == (2, "eimi: --resume: give the checkpoint of the interrupted fit, --checkpoint FILE\n")


def test_a_checkpoint_of_another_processor_is_resumed(beams: Path, tmp_path: Path, run: Run) -> None:
    # Another processor rounds differently: the last digits in the checkpoint (the log of an interrupted fit) differ.
    log, output = tmp_path / "log.jsonl", tmp_path / "fits.json"
    fit = ["fit", beams / "first.h5", "--model", "neo-hookean", "-o", output, "--checkpoint", log]
    assert run(*fit)[0] == 0
    whole = read(output)
    head, *generations, _finished = log.read_text().splitlines()
    first = json.loads(generations[0])
    first["search"]["step_size"] = math.nextafter(first["search"]["step_size"], math.inf)
    log.write_text("\n".join([head, json.dumps(first), *generations[1:-1]]))
    output.unlink()
    assert run(*fit, "--resume")[0] == 0
    assert read(output) == whole


def test_a_bootstrap_of_too_few_states_is_refused(beams: Path, tmp_path: Path, run: Run, monkeypatch: Any) -> None:
    monkeypatch.setattr("eimi_lab.fits.fit_grid.FEWEST_STATES", 6)
    status, message = run(
        "fit", beams / "first.h5", "--model", "neo-hookean", "--bootstrap", 3, "-o", tmp_path / "fits.json"
    )
    assert status == 2
    assert "first.h5: 5 states are too few; --bootstrap needs at least 6 states" in message


def test_there_are_no_more_workers_than_processors(monkeypatch: Any) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    chosen = executor_for(1000, None)
    assert isinstance(chosen, partial)
    assert chosen.args == (3,)


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_an_address_without_a_scheduler_is_refused_at_once(answer: bytes, monkeypatch: Any) -> None:
    pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'eimi-lab[cluster]'")
    monkeypatch.setattr("eimi_lab.process.workers._ANSWER_S", 1)
    with socket.create_server(("127.0.0.1", 0)) as service:

        def serve() -> None:
            connection, _ = service.accept()
            with connection:
                connection.sendall(answer)
                while connection.recv(1000):
                    pass

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{service.getsockname()[1]}"
        with pytest.raises(InputError, match=f"{address}: no dask scheduler answers there"), cluster(address):
            pass


def test_a_missing_scheduler_is_reported_in_one_line(beams: Path, tmp_path: Path, run: Run, monkeypatch: Any) -> None:
    pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'eimi-lab[cluster]'")
    monkeypatch.setattr("eimi_lab.process.workers._ANSWER_S", 1)
    arguments = ["--scheduler", "tcp://127.0.0.1:1", "-o", tmp_path / "fits.json"]
    arguments += ["--checkpoint", tmp_path / "log.jsonl"]
    status, message = run("fit", beams / "first.h5", "--model", "neo-hookean", *arguments)
    assert status == 2
    assert "eimi: --scheduler tcp://127.0.0.1:1: no dask scheduler answers there" in message
    assert list(tmp_path.iterdir()) == []
