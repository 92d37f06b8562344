"""A run that records a free vibration with frames from another process reports every lost frame."""

from __future__ import annotations

from pathlib import Path

from eimi_lab.dataset.reading import open_dataset
from tests.shared.streamed_run import record


def test_every_frame_of_a_fast_camera_is_stored_or_counted_as_lost(tmp_path: Path) -> None:
    streamed = record(tmp_path / "run.h5", 320, 240, 200.0, 2.0)
    assert streamed.identical
    with open_dataset(streamed.path) as dataset:
        ((step, frames),) = dataset.recorded_ring_downs()
    numbers = frames.numbers.tolist()
    assert len(numbers) == step.frames == streamed.stored.frames > 10
    assert numbers[-1] - numbers[0] + 1 == step.frames + step.lost
    assert ("RING_DOWN_LOST" in streamed.stored.flags) == (step.lost > 0)
    assert frames.elapsed_s[-1] > 0.4
