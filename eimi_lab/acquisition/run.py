"""The run: through the protocol's currents, and every state stored before the next one begins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.supplies.opening import supply_driver
from eimi_lab.acquisition.bench import Bench
from eimi_lab.acquisition.capture import capture
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.heating import refuse_overheating
from eimi_lab.acquisition.live_view import Show, WatchedCamera, show_nobody
from eimi_lab.acquisition.resuming import Begun, take_up
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S, measure_noise, wait_until_settled
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.grey import grey
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.errors import InputError
from eimi_lab.outputs import refuse_existing

NOISE_FRAMES = 8


def check_request(protocol: Protocol, specimen: SpecimenFile, rig: Rig) -> None:
    """Whether protocol, specimen and rig go together; asks no instrument.

    Raises InputError, and InstrumentError for a supply driver of another package that cannot be imported.
    """
    if protocol.material != specimen.specimen.material:
        raise InputError(
            f"protocol {protocol.name}: material = {protocol.material!r}, but the specimen {specimen.specimen.name} "
            f"is of {specimen.specimen.material!r}"
        )
    largest = max(map(abs, protocol.currents_A))
    limit = rig.supply.limits.current_A
    if largest > limit:
        raise InputError(
            f"protocol {protocol.name}: goes to {largest:g} A; "
            f"rig {rig.name} allows supply.limits.current_A = {limit:g}"
        )
    lowest = min(protocol.currents_A)
    if lowest < 0 and (rig.virtual or not supply_driver(rig.supply.driver).bipolar):
        raise InputError(
            f"protocol {protocol.name}: current.{protocol.current.key_of(lowest)} goes to {lowest:g} A at state "
            f"{protocol.currents_A.index(lowest)}, but supply.driver = {rig.supply.driver!r} of rig {rig.name} cannot "
            "reverse its current; take currents from 0 up, or a bipolar supply such as kepco-bop"
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
) -> None:
    """Run the protocol on an open bench into the dataset `path`; `report` gets a line for every state stored.

    resume: go on with the run that `path` holds. take_over: switch off a supply that is found on, not refuse it.
    note: what the user has to say of the run. show: is given every frame as it comes.

    Ends with the coil off, whatever happens; what was stored until then stays. Raises InputError before anything is
    switched on, InstrumentError, Stopped.
    """
    check_request(protocol, specimen, rig)
    if not resume:
        refuse_existing(path, force)
    supply, camera, clock = bench.supply, WatchedCamera(bench.camera, show), bench.clock
    identities = (supply.identify(), camera.identify())
    header = Header(
        specimen, rig.calibration, protocol, rig, identities, bench.truth, note, camera_settings=bench.camera_settings
    )
    _begin_with_output_off(bench, protocol, take_over)
    supply.check()
    supply.set_current(0.0)
    supply.set_voltage(supply.limits.voltage_V)
    camera.flush()
    at_rest = [camera.grab(GRAB_TIMEOUT_S) for _ in range(NOISE_FRAMES)]
    noise = measure_noise([grey(frame.image) for frame in at_rest])
    begun = take_up(path, header, grey(at_rest[0].image)) if resume else Begun(0, 0.0)
    for current in protocol.currents_A[: begun.states]:
        report(f"{current:g} A, stored before")
    if begun.states == len(protocol.currents_A):
        return
    coil = Coil(supply, clock, protocol.ramp)
    began = clock.now() - begun.elapsed_s
    with (
        DatasetWriter.resume(path) if resume else DatasetWriter(path, header, at_rest[0], force) as writer,
        switching_off(coil, bench.guardian) as stop_if_asked,
    ):
        stop_if_asked()
        supply.set_output(True)
        for current in protocol.currents_A[: begun.states]:  # a beam that remembers has to come the same way
            coil.ramp_to(current, stop_if_asked)
        for index, current in list(enumerate(protocol.currents_A))[begun.states :]:
            if bench.guardian:
                bench.guardian.check()
            camera.at(index, current)
            coil.ramp_to(current, stop_if_asked)
            coil.wait_until_reached(stop_if_asked)
            settled = wait_until_settled(camera, clock, protocol.settle, noise, stop_if_asked)
            supply.check()
            taken = capture(camera, clock, protocol.frames_per_state, coil.measured_A, noise, stop_if_asked)
            writer.append_state(
                taken.frames,
                current_A=current,
                field_mT=current * rig.calibration.coil_constant_mT_per_A,
                measured_A=taken.measured_A,
                time_s=[at - began for at in taken.time_s],
                flags=settled.flags + taken.flags,
            )
            flagged = "".join(f", {flag.name}" for flag in settled.flags + taken.flags)
            report(f"{current:g} A, settled after {settled.waited_s:.1f} s{flagged}")


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
