"""Apply load cycles before a run, and measure how far the cycles changed the shape of the beam.

Filled rubbers become softer when they are stretched for the first time (Mullins effect; L. Mullins, Rubber Chem.
Technol. 42 (1969) 339).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from eimi_lab.acquisition.events import ConditioningDone, ShapeChange
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S, wait_until_settled
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.config.protocol import Conditioning
from eimi_lab.dataset.recordings import CONDITIONING, Moment
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.intensity import mean_grey

Shape = tuple[int, Moment]
"""The number of a load cycle, counted from 1, and a frame of the beam at rest after this cycle."""


def condition(run: Stepping, rule: Conditioning, stop_if_asked: Callable[[], None]) -> None:
    """Apply the load cycles before a run, store frames of the beam at rest, and send `ConditioningDone`.

    Parameters
    ----------
    run : Stepping
        The run, with the output of the supply on.
    rule : Conditioning
        Number of the cycles, and their largest current (A).
    stop_if_asked : callable
        Called between the operations; raises an exception if the run has to stop.

    Raises
    ------
    InstrumentError
        If an instrument fails or the current is wrong.
    StorageFailed
        If the frames cannot be stored.
    Stopped
        If a signal asked the run to stop.
    """
    shapes = [(1, _at_rest(run, stop_if_asked))]
    for cycle in range(1, rule.cycles + 1):
        for current_A in (rule.current_A, 0.0):
            run.coil.ramp_to(current_A, stop_if_asked)
            run.coil.wait_until_reached(stop_if_asked)
            if cycle == rule.cycles or (cycle == 1 and current_A):
                shapes.append((cycle, _at_rest(run, stop_if_asked)))
            run.coil.supply.check()
    run.store(CONDITIONING, [cycle for cycle, _ in shapes], [moment for _, moment in shapes])
    run.on_event(ConditioningDone(cycles=rule.cycles, changes=tuple(_changes(run, shapes, stop_if_asked))))


def _at_rest(run: Stepping, stop_if_asked: Callable[[], None]) -> Moment:
    wait_until_settled(run.camera, run.clock, run.protocol.settle, run.noise, stop_if_asked)
    run.camera.flush()
    frame = run.camera.grab(GRAB_TIMEOUT_S)
    at_s = run.clock.now()
    return Moment(frame, at_s, at_s - run.coil.changed_s, run.coil.asked_A)


def _changes(run: Stepping, shapes: list[Shape], stop_if_asked: Callable[[], None]) -> Iterator[ShapeChange]:
    """Compare the recorded `shapes`: yield how far the load cycles changed the loaded and the unloaded beam.

    `shapes` are frames of the beam in equilibrium, each with the number of its load cycle.
    """
    for current_A in sorted({moment.set_A for _, moment in shapes}, key=abs, reverse=True):
        of_current = [(cycle, moment.frame) for cycle, moment in shapes if moment.set_A == current_A]
        if len(of_current) < 2:
            continue
        (first, before), (_, after) = of_current[0], of_current[-1]
        since = first if current_A else 0
        images = mean_grey(before.image), mean_grey(after.image)
        tips = []
        for image in images:
            stop_if_asked()
            tips.append(find_edges(image, run.calibration, run.specimen).corners_px[2:].mean(axis=0))
        moved_px = float(np.hypot(*(tips[1] - tips[0])))
        if not np.isfinite(moved_px):
            ratio = float(run.noise.difference_ratio(*images))
            yield ShapeChange(current_A=current_A, since_cycle=since, difference_ratio=ratio)
            continue
        moved_mm = float(np.hypot(*np.diff(BeamFrame(run.calibration).to_mm(tips), axis=0)[0]))
        yield ShapeChange(current_A=current_A, since_cycle=since, tip_moved_px=moved_px, tip_moved_mm=moved_mm)
