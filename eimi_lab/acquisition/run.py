"""Run a protocol: set its currents one after another, and store every state before the next state begins.

A state is one load step: a current, and the frames of the beam at rest under this current.
"""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from eimi_drivers.interfaces import SwitchOffFailed
from eimi_lab.acquisition.coil import Coil, without_contact
from eimi_lab.acquisition.conditioning import condition
from eimi_lab.acquisition.current_steps import refuse_between_steps
from eimi_lab.acquisition.event_words import left_behind
from eimi_lab.acquisition.events import (
    Event,
    Fault,
    OffConfirmed,
    OnEvent,
    OutputSwitched,
    RunBegun,
    RunEnded,
    StateStoredBefore,
    Warned,
    ignore_event,
)
from eimi_lab.acquisition.heating import hottest, refuse_overheating
from eimi_lab.acquisition.interlocks import Interlocks, readings_of
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.live_view import Show, WatchedCamera, show_nothing
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.output_off import begin_with_output_off
from eimi_lab.acquisition.pausing import Pauses, no_input
from eimi_lab.acquisition.playback import NOISE_FRAMES
from eimi_lab.acquisition.polarity import Polarity, cannot_reverse, swaps_leads
from eimi_lab.acquisition.resuming import UnfinishedRun, missing_ring_downs, refuse_taken, take_up
from eimi_lab.acquisition.ring_downs import record_ring_downs
from eimi_lab.acquisition.sensing import Sensing
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from eimi_lab.vision.intensity import mean_grey
from eimi_lab.vision.settling_statistic import measure_noise

_log = logging.getLogger(__name__)


def check_request(protocol: Protocol, specimen: SpecimenFile, rig: Rig) -> None:
    """Check that a protocol file, a specimen file and a rig file fit together. No instrument is used.

    Raises
    ------
    InputError
        If the three files do not fit together, for example because a current is above a limit.
    InstrumentError
        If the driver of the supply is not known or cannot be imported.
    """
    if protocol.material != specimen.specimen.material:
        raise InputError(
            f"protocol {protocol.name}: material = {protocol.material!r}, but the specimen {specimen.specimen.name} "
            f"has material = {specimen.specimen.material!r}"
        )
    limit = rig.supply.limits.current_A
    one_way = cannot_reverse(rig)
    for key, current_A in protocol.extremes_A:
        if abs(current_A) > limit:
            raise InputError(
                f"protocol {protocol.name}: {key} goes to {current_A:g} A; "
                f"rig {rig.name} allows supply.limits.current_A = {limit:g}"
            )
        in_swapped_coil = protocol.current.both_polarities and key != "conditioning.current_A"
        if current_A < 0 and one_way and not in_swapped_coil:
            at = f" at state {protocol.currents_A.index(current_A)}" if key.startswith("current.") else ""
            raise InputError(
                f"protocol {protocol.name}: {key} goes to {current_A:g} A{at}, but supply.driver = "
                f"{rig.supply.driver!r} of rig {rig.name} cannot reverse its current; use currents from 0 up, "
                "or a bipolar supply such as kepco-bop, or add both_polarities = true to [current] of the protocol to "
                "swap the leads of the coil during the run"
            )
    if protocol.ring_down:
        _check_ring_down(protocol, one_way)
    for sensor in rig.sensors:
        strict_A = rig.supply.limits.stricter(protocol.limits).current_A
        if sensor.at_rest_A is not None and sensor.at_rest_A > strict_A:
            raise InputError(
                f"rig {rig.name}: the sensor {sensor.name} measures the resistance of the coil with the current "
                f"at_rest_A = {sensor.at_rest_A:g} A; it should be at most {strict_A:g} A, the smaller of the limits "
                "in rig and protocol"
            )
    if protocol.tip_force_N and rig.virtual:
        raise InputError(
            f"protocol {protocol.name}: tip_force_N = {protocol.tip_force_N:g}, but a virtual beam has no weight at "
            "its tip; leave tip_force_N out"
        )
    rate_Hz = protocol.rate_Hz
    if rate_Hz and rig.camera.frame_rate_Hz and rig.camera.frame_rate_Hz < rate_Hz:
        raise InputError(
            f"protocol {protocol.name}: ring_down.rate_Hz = {rate_Hz:g}, but rig {rig.name} sets "
            f"camera.frame_rate_Hz = {rig.camera.frame_rate_Hz:g}; change one of the two rates"
        )
    if rig.coil:
        refuse_overheating(protocol, rig.coil)


def _check_ring_down(protocol: Protocol, one_way: bool) -> None:
    """Raise InputError for a ring-down from zero current, or from a current that the coil cannot have after the states.

    `one_way` is true if the supply cannot reverse its current.
    """
    from_A = protocol.ring_down_from_A
    if from_A == 0:
        raise InputError(
            f"protocol {protocol.name}: ring_down: the last current of the run is 0 A, from which the beam does not "
            "move; give ring_down.from_A, the current before the step to zero"
        )
    if from_A > 0 and one_way and protocol.current.both_polarities:
        raise InputError(
            f"protocol {protocol.name}: ring_down.from_A = {from_A:g} should be negative, because the leads of the "
            f"coil are swapped after the last state; use {-from_A:g}, or leave the key out"
        )


def acquire(
    protocol: Protocol,
    specimen: SpecimenFile,
    rig: Rig,
    bench: Bench,
    path: Path,
    on_event: OnEvent = ignore_event,
    force: bool = False,
    *,
    resume: bool = False,
    take_over: bool = False,
    note: str = "",
    show: Show = show_nothing,
    typed: Callable[[], str | None] = no_input,
) -> Path:
    """Run a protocol on an open bench, and store its states (load steps) in a dataset.

    The coil is off at the end, also after an error. The stored states stay in the dataset.

    Parameters
    ----------
    protocol, specimen, rig
        The contents of the protocol file, the specimen file and the rig file.
    bench : Bench
        The open instruments.
    path : Path
        The dataset to write.
    on_event : OnEvent
        Receives the events (records of what happened).
    force : bool
        Whether an existing dataset is replaced.
    resume : bool
        Whether the run in the dataset `path` is continued.
    take_over : bool
        Whether to switch off an output that is already on; otherwise the run is refused.
    note : str
        A remark of the person, for the dataset.
    show : Show
        Receives every frame of the camera, for a live view.
    typed : callable
        Returns the next line that a person typed to begin or end a pause; None if no line was typed.

    Returns
    -------
    Path
        The path of the dataset: `path`, or a copy beside it if `path` was deleted, moved or replaced meanwhile.

    Raises
    ------
    InputError
        If an input cannot be used. The output was then not switched on.
    InstrumentError
        If an instrument fails or does not follow a command.
    StorageFailed
        If a state cannot be stored.
    Stopped
        If a signal stopped the run.
    """
    check_request(protocol, specimen, rig)
    if swaps_leads(protocol, rig) and bench.relay is None and typed is no_input:
        raise InputError(
            f"protocol {protocol.name}: current.both_polarities = true: supply.driver = {rig.supply.driver!r} of rig "
            f"{rig.name} cannot reverse its current, and a person has to swap the leads; start the run on a terminal"
        )
    if not resume:
        refuse_taken(path, force)
    ending = _Ending(path, protocol)
    with _with_first_and_last_event(_run_begun(protocol, specimen, rig, bench, path, resume), ending, on_event) as send:
        supply, camera, clock = bench.supply, WatchedCamera(bench.camera, show, bench.cue), bench.clock

        def beat() -> None:
            if bench.guardian:
                bench.guardian.beat()
            bench.interruption.while_storing()

        def warn(message: str) -> None:
            send(Warned(message=message))

        sensing = Sensing(bench.sensors, clock, warn, beat)
        sensor_identities, sensors = sensing.begin()
        identities = (supply.identify(), camera.identify(), *sensor_identities)
        if bench.steps_known:
            try:
                refuse_between_steps(protocol, supply)
            except InputError as error:
                if not resume:
                    raise
                warn(f"{error}; the run is continued as it was begun, with currents rounded toward zero")
        if bench.guardian:
            bench.guardian.expect(identities[0])
        header = Header(
            specimen,
            rig.calibration,
            protocol,
            rig,
            identities,
            bench.truth,
            note,
            camera_settings=bench.camera_settings,
            without_contact="" if bench.truth else without_contact(supply),
            sensors=sensors,
        )
        begin_with_output_off(bench, protocol.ramp, take_over, rig.simulated, send)
        interlocks = Interlocks(rig.interlocks, send)
        if interlocks:
            interlocks.refuse_to_begin({**readings_of(supply.measure()), **sensing.values()})
        supply.check()
        supply.set_current(0.0)
        supply.set_voltage(supply.limits.voltage_V)
        camera.flush()
        at_rest = [camera.grab(GRAB_TIMEOUT_S) for _ in range(NOISE_FRAMES)]
        noise = measure_noise([mean_grey(frame.image) for frame in at_rest])
        begun = take_up(path, header, at_rest[0].image) if resume else UnfinishedRun(0, 0.0)
        for state, current_A in enumerate(protocol.currents_A[: begun.states]):
            send(StateStoredBefore(state=state, current_A=current_A))
        if begun.states == len(protocol.currents_A) and not missing_ring_downs(protocol, begun.ring_downs):
            ending.stored = begun.states
            return path

        with (
            DatasetWriter.resume(path, beat, warn)
            if resume
            else DatasetWriter(path, header, at_rest[0], force, beat, warn) as writer
        ):
            stepping = Stepping(
                protocol=protocol,
                specimen=specimen,
                calibration=rig.calibration,
                coil=Coil(
                    supply,
                    clock,
                    protocol.ramp,
                    simulated=rig.simulated,
                    interlocks=interlocks,
                    sense=sensing.values,
                ),
                camera=camera,
                clock=clock,
                sensing=sensing,
                guardian=bench.guardian,
                noise=noise,
                writer=writer,
                began_s=clock.now() - begun.elapsed_s,
                on_event=send,
            )
            ending.writer = writer
            pauses = Pauses(typed, send)
            polarity = Polarity(pauses if swaps_leads(protocol, rig) else None, bench.relay)
            _step_through(stepping, begun.states, bench.interruption, pauses, polarity, ending)
    return writer.path


@dataclass
class _Ending:
    # What the last event of a run reports: the dataset, numbers of states (load steps), and whether the coil is off.
    # `path` and `stored` are used only if `writer`, the open dataset, is None.

    path: Path
    protocol: Protocol
    stored: int | None = None
    writer: DatasetWriter | None = None
    off: OffConfirmed | None = None

    def event(self, status: Literal["completed", "stopped", "failed"], reason: str = "") -> RunEnded:
        path, stored = (self.writer.path, self.writer.stored) if self.writer else (self.path, self.stored)
        return RunEnded(
            status=status,
            reason=reason,
            stored=stored,
            states=len(self.protocol.currents_A),
            dataset=str(path),
            missing_ring_downs=missing_ring_downs(self.protocol, self.writer.ring_downs) if self.writer else 0,
        )


def _run_begun(
    protocol: Protocol, specimen: SpecimenFile, rig: Rig, bench: Bench, path: Path, resume: bool
) -> RunBegun:
    return RunBegun(
        dataset=str(path),
        protocol=protocol.name,
        specimen=specimen.specimen.name,
        rig=rig.name,
        states=len(protocol.currents_A),
        currents_A=tuple(protocol.currents_A),
        resumes=resume,
        guardian=bench.guardian is not None,
        without_contact="" if rig.simulated else without_contact(bench.supply),
        hottest_share=hottest(protocol, rig.coil).share if rig.coil else None,
        interlocks=tuple(interlock.reading for interlock in rig.interlocks),
    )


def _failed_to_switch_off(error: BaseException) -> SwitchOffFailed | None:
    # Return the failure to switch the coil off that was followed by another error, if there is one.
    before = error.__context__
    while before is not None and not isinstance(before, SwitchOffFailed):
        before = before.__context__
    return before


@contextmanager
def _with_first_and_last_event(begun: RunBegun, ending: _Ending, on_event: OnEvent) -> Iterator[OnEvent]:
    """Send the first and the last event of a run, and yield a function that sends the events between them.

    After an error, a `Fault` is sent before the last event.
    """

    def send(event: Event) -> None:
        _log.info("%s", event)
        if isinstance(event, OffConfirmed):
            ending.off = event
        on_event(event)

    send(begun)
    try:
        yield send
    except Stopped as stopped:
        send(ending.event("stopped", signal.Signals(stopped.number).name))
        raise
    except BaseException as error:
        still_on = _failed_to_switch_off(error) if isinstance(error, StorageFailed) else None
        if still_on:
            send(Warned(message=str(error)))
        reported = still_on or error  # a coil that may be on is more important than a full disk
        send(Fault(kind=type(reported).__name__, message=str(reported)))
        send(ending.event("failed", type(reported).__name__))
        if still_on:
            raise still_on from None
        raise
    send(ending.event("completed"))


def _step_through(
    run: Stepping, first: int, interruption: Interruption, pauses: Pauses, polarity: Polarity, ending: _Ending
) -> None:
    """Switch the output on, carry out the run from state (load step) number `first` on, and switch the output off."""
    protocol, states = run.protocol, len(run.protocol.currents_A)
    try:
        with (
            ExitStack() as unfinished,
            switching_off(run.coil, run.guardian, interruption, run.on_event) as stop_if_asked,
        ):
            stop_if_asked()
            run.coil.supply.set_output(True)
            run.on_event(OutputSwitched(on=True))
            run.sensing.measure_at_rest(run.coil, stop_if_asked)
            if protocol.conditioning and not first:
                condition(run, protocol.conditioning, stop_if_asked)
            if not polarity.prepare(run, first, stop_if_asked):
                run.go_back_to(first, stop_if_asked)
            for state in range(first, states):
                if pauses.asked:
                    pauses.wait(run, state, stop_if_asked)
                polarity.prepare(run, state, stop_if_asked)
                is_last = state == states - 1 and not protocol.ring_down
                run.take(state, stop_if_asked if is_last else pauses.heeded_by(stop_if_asked))
            if protocol.ring_down:
                if pauses.asked:
                    pauses.wait(run, states, stop_if_asked)
                record_ring_downs(run, protocol.ring_down, unfinished, stop_if_asked)
    except Stopped as stopped:
        raise Stopped(stopped.number, left_behind(ending.off, ending.event("stopped"))) from stopped
    finally:
        run.report_lost_frames(None)
        polarity.remind(run)
        run.writer.append_set_points(run.new_set_points())
