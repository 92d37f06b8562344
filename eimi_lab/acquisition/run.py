"""The run: through the protocol's currents, and every state stored before the next one begins."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.supplies.supply_names import is_bipolar
from eimi_lab.acquisition.coil import Coil, never, without_contact
from eimi_lab.acquisition.conditioning import condition
from eimi_lab.acquisition.heating import refuse_overheating
from eimi_lab.acquisition.live_view import Show, WatchedCamera, show_nobody
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.pausing import Pauses, nobody_types
from eimi_lab.acquisition.playback import NOISE_FRAMES
from eimi_lab.acquisition.resuming import UnfinishedRun, refuse_taken, take_up
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.acquisition.transients import record_release
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.recordings import RELEASE, Moment
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.stopping import Stopped
from eimi_lab.vision.intensity import mean_grey
from eimi_lab.vision.settling_statistic import measure_noise


def check_request(protocol: Protocol, specimen: SpecimenFile, rig: Rig) -> None:
    """Whether protocol, specimen and rig go together; asks no instrument.

    Raises InputError, and InstrumentError for a supply driver of another package that cannot be imported.
    """
    if protocol.material != specimen.specimen.material:
        raise InputError(
            f"protocol {protocol.name}: material = {protocol.material!r}, but the specimen {specimen.specimen.name} "
            f"is of {specimen.specimen.material!r}"
        )
    limit = rig.supply.limits.current_A
    one_way = rig.simulated or not is_bipolar(rig.supply.driver)
    for key, current_A in protocol.extremes_A:
        if abs(current_A) > limit:
            raise InputError(
                f"protocol {protocol.name}: {key} goes to {current_A:g} A; "
                f"rig {rig.name} allows supply.limits.current_A = {limit:g}"
            )
        if current_A < 0 and one_way:
            at = f" at state {protocol.currents_A.index(current_A)}" if key.startswith("current.") else ""
            raise InputError(
                f"protocol {protocol.name}: {key} goes to {current_A:g} A{at}, but supply.driver = "
                f"{rig.supply.driver!r} of rig {rig.name} cannot reverse its current; take currents from 0 up, or a "
                "bipolar supply such as kepco-bop"
            )
    if protocol.tip_force_N and rig.virtual:
        raise InputError(
            f"protocol {protocol.name}: tip_force_N = {protocol.tip_force_N:g}: a virtual beam bears no weight"
        )
    if rig.coil:
        refuse_overheating(protocol, rig.coil)


def acquire(
    protocol: Protocol,
    specimen: SpecimenFile,
    rig: Rig,
    bench: Bench,
    path: Path,
    report: Callable[[str], None],
    force: bool = False,
    *,
    resume: bool = False,
    take_over: bool = False,
    note: str = "",
    show: Show = show_nobody,
    remark: Callable[[str], None] = tell,
    typed: Callable[[], str | None] = nobody_types,
) -> Path:
    """Run the protocol on an open bench into the dataset `path`; `report` gets a line for every state stored.

    Returns where the dataset is: beside `path` where that was taken away meanwhile.

    resume: go on with the run that `path` holds. take_over: switch off a supply that is found on, not refuse it.
    note: what the user has to say of the run. show: is given every frame as it comes. remark: gets what else there is
    to say in a line, such as what the conditioning changed. typed: gives what a person types, for `pausing`.

    Ends with the coil off, whatever happens; what was stored until then stays. Raises InputError before anything is
    switched on, InstrumentError, Stopped.
    """
    check_request(protocol, specimen, rig)
    if not resume:
        refuse_taken(path, force)
    supply, camera, clock = bench.supply, WatchedCamera(bench.camera, show, bench.cue), bench.clock
    identities = (supply.identify(), camera.identify())
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
    )
    _begin_with_output_off(bench, protocol, take_over)
    supply.check()
    supply.set_current(0.0)
    supply.set_voltage(supply.limits.voltage_V)
    camera.flush()
    at_rest = [camera.grab(GRAB_TIMEOUT_S) for _ in range(NOISE_FRAMES)]
    noise = measure_noise([mean_grey(frame.image) for frame in at_rest])
    begun = take_up(path, header, at_rest[0].image) if resume else UnfinishedRun(0, 0.0)
    for current in protocol.currents_A[: begun.states]:
        report(f"{current:g} A, stored before")
    if begun.states == len(protocol.currents_A):
        return path
    coil = Coil(supply, clock, protocol.ramp)

    def beat() -> None:
        if bench.guardian:
            bench.guardian.beat()
        coil.meanwhile()

    with DatasetWriter.resume(path, beat) if resume else DatasetWriter(path, header, at_rest[0], force, beat) as writer:
        stepping = Stepping(
            protocol=protocol,
            specimen=specimen,
            calibration=rig.calibration,
            coil=coil,
            camera=camera,
            clock=clock,
            guardian=bench.guardian,
            noise=noise,
            writer=writer,
            began_s=clock.now() - begun.elapsed_s,
            remark=remark,
        )
        _step_through(stepping, begun.states, report, Pauses(typed, remark))
    return writer.path


def _step_through(run: Stepping, first: int, report: Callable[[str], None], pauses: Pauses) -> None:
    """The conditioning, every state from `first` on and the release, with the output on; off after it, come what may.

    A run that is resumed was conditioned when it began.
    """
    protocol, states = run.protocol, len(run.protocol.currents_A)
    released: list[Moment] = []
    try:
        with switching_off(run.coil, run.guardian) as stop_if_asked, watching(run.camera, stop_if_asked):
            stop_if_asked()
            run.coil.supply.set_output(True)
            if protocol.conditioning and not first:
                condition(run, protocol.conditioning, stop_if_asked)
            run.go_back_to(first, stop_if_asked)
            for state in range(first, states):
                if pauses.asked:
                    pauses.wait(run, state, stop_if_asked)
                report(run.take(state, pauses.heeded_by(stop_if_asked)))
            if protocol.release:
                released += record_release(run.camera, run.clock, run.coil, protocol.release.seconds, stop_if_asked)
    except Stopped as stopped:
        run.store(RELEASE, [states - 1] * len(released), released)
        raise Stopped(stopped.number, f"the coil is off; {run.what_is_stored()}") from stopped
    except InstrumentError:
        run.remark(run.what_is_stored())
        raise
    run.store(RELEASE, [states - 1] * len(released), released)


@contextmanager
def watching(camera: WatchedCamera, stop_if_asked: Callable[[], None]) -> Iterator[None]:
    """The run moves on, and can be stopped, while it waits for the camera."""
    if not isinstance(camera.watched, TimedCamera):
        yield
        return
    camera.watched.meanwhile = stop_if_asked
    try:
        yield
    finally:
        camera.watched.meanwhile = never


def _begin_with_output_off(bench: Bench, protocol: Protocol, take_over: bool) -> None:
    """Refuse a supply that is on, or ramp it down and switch it off. Raises InstrumentError, Stopped."""
    supply = bench.supply
    if not supply.output_on():
        return
    found = supply.measure()
    if not take_over:
        raise InstrumentError(
            f"{supply.identify().address}: the output is on ({found.current_A:.3f} A, {found.voltage_V:.2f} V): "
            "another program may use it, or one died; a run begins with it off, and --take-over switches it off first"
        )
    limit = supply.limits.current_A
    coil = Coil(supply, bench.clock, protocol.ramp, asked_A=max(-limit, min(found.current_A, limit)))
    with switching_off(coil, bench.guardian):
        return
