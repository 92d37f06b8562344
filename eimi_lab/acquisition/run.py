"""The run: through the protocol's currents, and every state stored before the next one begins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition.bench import Bench
from eimi_lab.acquisition.capture import capture
from eimi_lab.acquisition.coil import Coil
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
    """Whether protocol, specimen and rig go together; asks no instrument. Raises InputError."""
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


def acquire(
    protocol: Protocol,
    specimen: SpecimenFile,
    rig: Rig,
    bench: Bench,
    path: Path,
    report: Callable[[str], None],
    force: bool = False,
) -> None:
    """Run the protocol on an open bench into the new dataset `path`; `report` gets a line for every state stored.

    Ends with the coil off, whatever happens; what was stored until then stays. Raises InputError before anything is
    switched on, InstrumentError, Stopped.
    """
    check_request(protocol, specimen, rig)
    refuse_existing(path, force)
    supply, camera, clock = bench.supply, bench.camera, bench.clock
    identities = (supply.identify(), camera.identify())
    if supply.output_on():
        raise InstrumentError(
            f"{identities[0].address}: the output is on; a run begins with it off, so that the beam is seen at rest"
        )
    supply.check()
    supply.set_current(0.0)
    supply.set_voltage(supply.limits.voltage_V)
    camera.flush()
    at_rest = [camera.grab(GRAB_TIMEOUT_S) for _ in range(NOISE_FRAMES)]
    noise = measure_noise([grey(frame.image) for frame in at_rest])
    header = Header(specimen, rig.calibration, protocol, rig, identities, bench.truth)
    coil = Coil(supply, clock, protocol.ramp)
    began = clock.now()
    with DatasetWriter(path, header, at_rest[0], force) as writer, switching_off(coil) as stop_if_asked:
        supply.set_output(True)
        for current in protocol.currents_A:
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
