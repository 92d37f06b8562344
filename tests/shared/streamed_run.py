"""Record the free vibration after a step of the current, with a camera in another process and an emulated supply."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Limits
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition.events import Event, RingDownStored
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from tests.shared.streaming_camera import PRE_RENDERED, StreamingCamera, noisy_frames

PROTOCOL = """
name = "streamed"
material = "Dragon Skin 10"
frames_per_state = 1
transients = {{ frames_per_state = 0 }}
ring_down = {{ seconds = {seconds}, rate_Hz = {rate_Hz} }}
current = {{ values_A = [0.0, 0.3] }}
ramp = {{ rate_A_per_s = 10.0, step_A = 0.3, tolerance_A = 0.02 }}
limits = {{ current_A = 1.0, voltage_V = 10.0 }}
settle = {{ noise_ratio = 3.0, pairs = 1, drift_window_s = 0.05, timeout_s = 2.0 }}
"""


@dataclass(frozen=True)
class Streamed:
    # A recorded run: its file, the report of its free vibration, and whether all stored frames equal those taken.

    path: Path
    stored: RingDownStored
    identical: bool


@contextmanager
def streaming(width: int, height: int, rate_Hz: float) -> Iterator[TimedCamera]:
    """Yield the camera with a time limit for every call, and close it at the end."""
    started = StreamingCamera(width, height, rate_Hz)
    with closing(TimedCamera("memory", lambda: started)) as camera:
        started.wait_for_first_frame()
        yield camera


def record(path: Path, width: int, height: int, rate_Hz: float, seconds: float) -> Streamed:
    """Record a free vibration with frames from another process, and compare each stored frame with its original."""
    clock = WallClock()
    coil = CoilSupply(clock, current_noise_A=0.0005)
    supply = KoradSupply(InProcessTransport(KoradDialect(coil), clock), Limits(1.0, 10.0), clock)
    protocol = parse(Protocol, PROTOCOL.format(seconds=seconds, rate_Hz=rate_Hz), "protocol")
    events: list[Event] = []
    with streaming(width, height, rate_Hz) as camera:
        bench = Bench(supply, camera, clock, camera_settings=camera.settings)
        acquire(protocol, load_specimen("type1"), load_rig("bench_example"), bench, path, events.append)
    (stored,) = [event for event in events if isinstance(event, RingDownStored)]
    images = noisy_frames(width, height)
    with open_dataset(path) as dataset:
        ((_, frames),) = dataset.recorded_ring_downs()
        identical = all(
            np.array_equal(image, images[number % PRE_RENDERED])
            for image, number in zip(frames.images(), frames.numbers, strict=True)
        )
    return Streamed(path, stored, identical)
