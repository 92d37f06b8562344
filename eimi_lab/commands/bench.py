"""Commands for the bench: instruments, emulate, acquire, calibrate-coil and recover."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Protocol, Specimen
from eimi_lab.process.errors import InputError

BENCH = "bench"
"""The argument of `eimi emulate` for all instruments of a rig together."""
_MT_PER_A = 4.7
_AFTER_S = 5.0


def instruments(
    driver: Annotated[
        str | None, typer.Argument(help="with --try: name of the driver of the supply", show_default=False)
    ] = None,
    address: Annotated[str | None, typer.Argument(help="with --try: address of the supply", show_default=False)] = None,
    try_: Annotated[
        bool,
        typer.Option(
            "--try",
            help="test the driver on a real supply without a coil; write a report, and next to it a record of all "
            "messages",
        ),
    ] = False,
    who: Annotated[
        str | None, typer.Option(metavar="NAME", help="with --try: your name and laboratory, for the report")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="with --try: file for the report (Markdown)")
    ] = None,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="with --try: ask no questions; give this option only if nothing is connected to the output of the "
            "supply",
        ),
    ] = False,
) -> Result:
    """List the attached instruments and their drivers.

    With --try, the driver of one supply (the source of the coil's current) is tested. First disconnect everything from
    the output of the supply. The output is then switched on at 1 V for a few seconds. If only one supply is attached,
    DRIVER and ADDRESS can be left out.
    """
    from eimi_drivers.discovery import discover

    if try_:
        from eimi_lab.commands.trying import try_one_supply

        return try_one_supply(driver, address, who, output, yes)
    if driver or address or who or output or yes:
        raise InputError("DRIVER, ADDRESS, --who, -o and --yes: are only for --try; add --try or leave them out")
    result = discover()
    lines = [
        f"{instrument.kind}: driver = {instrument.driver}, address or source = {instrument.address} ({instrument.text})"
        for instrument in result.found
    ] or ["no supply and no camera was found; `eimi emulate korad` starts an emulated supply"]
    lines += [f"note: {note}" for note in result.notes]
    return Result(lines, {"found": [asdict(instrument) for instrument in result.found], "notes": result.notes})


def _list_faults(wanted: bool) -> None:
    """If ``wanted`` is True, print what each fault of `eimi emulate --fault` does, and end the program."""
    if not wanted:
        return
    from eimi_drivers.emulators.faults import Fault
    from eimi_drivers.emulators.sensors import SensorFault

    for fault in (*Fault, *SensorFault):
        print(f"{fault.word}: {fault.effect}. A correct program {fault.correct}.")
    raise typer.Exit


def emulate(
    supply: Annotated[
        str,
        typer.Argument(
            help="driver of the supply or sensor to emulate: korad, scpi, lakeshore-425, ...; or the word bench, to "
            "emulate all instruments that RIG names; not needed with --faults"
        ),
    ],
    rig: Annotated[
        str | None,
        typer.Argument(
            help="only for `emulate bench`: rig.toml, or the name of a rig that comes with the program, such as virtual"
        ),
    ] = None,
    tcp: Annotated[
        int | None,
        typer.Option(
            help="accept connections at this TCP port instead of making a virtual serial port (pseudo-terminal); 0 "
            "chooses a free port",
            min=0,
            max=65535,
        ),
    ] = None,
    fault: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="simulated fault of the supply, of the coil or of the connection (--faults describes them): "
            "silence, sleep, garbage, partial, slow, drop, disconnect, reenumerate, swap, shorted, drift, fallen, "
            "offset, locked, hunting, trip or brownout",
        ),
    ] = None,
    after: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.0,
            help="time until the fault begins, in seconds, counted from the moment at which the output is on and its "
            "current is not zero",
        ),
    ] = _AFTER_S,
    faults: Annotated[
        bool,
        typer.Option(
            "--faults",
            is_eager=True,
            callback=_list_faults,
            help="print what each fault of --fault does and what a correct program does then, and exit",
        ),
    ] = False,
    without_coil: Annotated[
        bool,
        typer.Option(
            "--without-coil", help="emulate a supply to which no coil is connected, for `eimi instruments --try`"
        ),
    ] = False,
    coil: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="for a gaussmeter: address of the emulated coil whose field the gaussmeter measures; `eimi emulate "
            "SUPPLY`, which you start before, prints this address in a line that begins with #",
        ),
    ] = None,
    mT_per_A: Annotated[
        float,
        typer.Option("--mT-per-A", help="for an emulated gaussmeter: field of the coil, in mT for each ampere"),
    ] = _MT_PER_A,
    offset_mT: Annotated[
        float,
        typer.Option("--offset-mT", help="for an emulated gaussmeter: its reading without a current, in mT"),
    ] = 0.0,
    specimen: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="only for `emulate bench`: specimen.toml, or the name of a specimen that comes with the program, such "
            "as type1",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            show_default="bench.toml",
            help="only for `emulate bench`: rig file to write, with the addresses of the emulated instruments; "
            "`eimi acquire --rig FILE` then measures with these instruments",
        ),
    ] = None,
    packet_loss: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            min=0.0,
            max=1.0,
            help="only for `emulate bench`: fraction of the data packets of the camera that are lost, from 0 to 1",
        ),
    ] = 0.0,
    force: Force = False,
) -> None:
    """Emulate one instrument, or a whole bench, until Ctrl-C.

    The address of the emulated supply or sensor is printed. At this address it obeys the commands of the real
    instrument. With --fault, the true current in the coil is printed whenever it changes. `eimi emulate bench` emulates
    a supply, the sensors and a GigE camera, which shows the virtual beam in the field of the coil. The command also
    writes a rig file with the addresses of these instruments.
    """
    of_gaussmeter = {"--coil": coil is not None, "--mT-per-A": mT_per_A != _MT_PER_A, "--offset-mT": offset_mT != 0.0}
    of_bench = {"--output": output is not None, "--force": force, "--packet-loss": packet_loss > 0.0}
    if fault is None and after != _AFTER_S:
        raise InputError(f"--after {after:g}: is only used with --fault; leave it out")
    if supply == BENCH:
        _refuse_unused(supply, {"--tcp": tcp is not None, "--without-coil": without_coil, **of_gaussmeter})
        _serve_bench(rig, specimen, output or Path("bench.toml"), force, fault, after, packet_loss)
        return
    if rig is not None or specimen is not None:
        raise InputError(f"RIG and --specimen: are only for `eimi emulate {BENCH}`; leave them out for {supply!r}")
    from eimi_drivers.clock import WallClock
    from eimi_drivers.emulators.faults import Fault
    from eimi_drivers.emulators.sensor_session import SENSOR_FAULTS, EmulatedSensorSession
    from eimi_drivers.emulators.sensors import SENSOR_DIALECTS
    from eimi_drivers.emulators.serve import DIALECTS
    from eimi_drivers.emulators.session import OPEN_OHM, EmulatedSession
    from eimi_drivers.emulators.supply import CoilSupply

    if supply in SENSOR_DIALECTS:
        if fault is not None and fault not in SENSOR_FAULTS:
            raise InputError(f"--fault = {fault!r}: should be one of {', '.join(SENSOR_FAULTS)} for a sensor")
        _refuse_unused(supply, {"--without-coil": without_coil, **of_bench})
        begins = SENSOR_FAULTS[fault] if fault is not None else None
        EmulatedSensorSession(
            supply, tcp, coil, mT_per_A, offset_mT, begins, after, lambda text: print(text, flush=True)
        ).serve()
    if supply not in DIALECTS:
        raise InputError(f"SUPPLY = {supply!r} should be one of {', '.join([*DIALECTS, *SENSOR_DIALECTS])}")
    _refuse_unused(supply, {**of_bench, **of_gaussmeter})
    by_word = {each.word: each for each in Fault}
    if fault is not None and fault not in by_word:
        raise InputError(f"--fault = {fault!r} should be one of {', '.join(by_word)}")
    chosen = by_word[fault] if fault is not None else None
    coil_supply = CoilSupply(WallClock(), resistance_ohm=OPEN_OHM) if without_coil else None
    EmulatedSession(supply, tcp, chosen, after, lambda text: print(text, flush=True), coil=coil_supply).serve()


def _refuse_unused(supply: str, given: Mapping[str, bool]) -> None:
    """Raise InputError if an option is given that the emulation of a supply, a sensor or a bench does not use."""
    for option, is_given in given.items():
        if is_given:
            raise InputError(f"{option}: is not used by `eimi emulate {supply}`; leave it out")


def _serve_bench(
    rig: str | None,
    specimen: str | None,
    output: Path,
    force: bool,
    fault: str | None,
    after_s: float,
    packet_loss: float,
) -> None:
    from eimi_drivers.emulators.faults import Fault
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.virtual.served_bench import ServedBench

    if rig is None or specimen is None:
        raise InputError(f"RIG or --specimen is missing; give both: `eimi emulate {BENCH} RIG --specimen FILE`")
    by_word = {each.word: each for each in Fault}
    if fault is not None and fault not in by_word:
        raise InputError(f"--fault = {fault!r} should be one of {', '.join(by_word)}")
    check_distinct([Path(rig), Path(specimen)], [output])
    refuse_existing(output, force)
    ServedBench(
        load_rig(rig),
        load_specimen(specimen),
        output,
        lambda text: print(text, flush=True),
        force=force,
        fault=by_word[fault] if fault is not None else None,
        after_s=after_s,
        packet_loss=packet_loss,
    ).serve()


def acquire(
    protocol: Protocol,
    specimen: Specimen,
    rig: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="rig.toml, which names the instruments, or the name of a rig that comes with the program, such as "
            "virtual",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="dataset to write; not needed with --dry-run"),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="only print the steps of the run; no instrument is used")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "-v", "--verbose", help="with --dry-run: also print every state (load step) and every message to the supply"
        ),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="continue the interrupted run in the dataset given with -o")
    ] = False,
    take_over: Annotated[
        bool,
        typer.Option(
            "--take-over",
            help="allow the run if the output of the supply is on before the run; the output is switched off first",
        ),
    ] = False,
    note: Annotated[
        str, typer.Option(metavar="TEXT", help="text that is stored in the dataset together with the run")
    ] = "",
    transcript: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="new file for a record of every message to and from the supply"),
    ] = None,
    events: Annotated[
        bool,
        typer.Option("--events", help="print the events of the run on standard output, one JSON object in each line"),
    ] = False,
    force: Force = False,
    watched_by: Annotated[
        str | None,
        typer.Option(hidden=True, help="file descriptors by which the live page exchanges messages with this run"),
    ] = None,
) -> Result:
    """Run a protocol on the bench (set-up) and store the frames.

    The program sets each current of the protocol, waits until the beam is at rest, and takes frames. At the end of the
    run the coil is switched off, also after an error or Ctrl-C.
    """
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.face.acquiring import dry_steps, run_protocol
    from eimi_lab.process.outputs import check_distinct

    read = list(dict.fromkeys(map(Path, (protocol, specimen, rig))))
    if output is not None and not dry_run:
        check_distinct(read, [output])
    chosen, beam, bench_rig = load_protocol(protocol), load_specimen(specimen), load_rig(rig)
    if dry_run:
        if events:
            raise InputError(
                "--events: --dry-run starts no run, so that there are no events; leave out --events or --dry-run"
            )
        summary, whole = dry_steps(chosen, beam, bench_rig)
        return Result(whole if verbose else summary, {"dry_run": whole})
    if verbose:
        raise InputError("-v: is only for --dry-run; to record the messages of a run, give --transcript FILE")
    if output is None:
        raise InputError("-o FILE.h5 is missing; give the dataset to write (not needed with --dry-run)")
    if watched_by is not None:
        # STOP of the live page sends this signal. A shell that starts the page in the background has it ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    stored = run_protocol(
        chosen,
        beam,
        bench_rig,
        output,
        resume=resume,
        take_over=take_over,
        note=note,
        transcript=transcript,
        events=events,
        force=force,
        watched_by=watched_by,
    )
    states = len(chosen.currents_A)
    lines = [] if events else [f"{stored}: {states} states"]  # the events alone are on standard output
    return Result(lines, {"dataset": stored, "states": states})


def calibrate_coil(
    rig: Annotated[str, typer.Option(metavar="FILE", help="rig.toml with a gaussmeter in [[sensors]]")],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FILE", help="new calibration file; the calibration of the rig is not changed"
        ),
    ] = Path("calibration.toml"),
    largest: Annotated[
        float | None,
        typer.Option(
            metavar="AMPERE", help="largest current, in ampere", show_default="the largest current that the rig allows"
        ),
    ] = None,
    steps: Annotated[
        int,
        typer.Option(
            help="number of currents from zero to the largest current, both included, in equal steps",
            min=2,
            max=200,
        ),
    ] = 6,
    force: Force = False,
) -> Result:
    """Measure the field of the coil with a gaussmeter.

    First remove the specimen, because its magnet also has a field. Then put the probe where the magnet was. The current
    increases in steps and returns to zero; if the supply can reverse the current, this is repeated with the opposite
    sign. The new file is a copy of the rig's calibration, to which the measured coil constant, the measured field
    without a current, their uncertainties, and the table of readings are added.
    """
    from datetime import date

    from eimi_lab.acquisition.coil_calibration import calibrate_coil as measure
    from eimi_lab.acquisition.coil_calibration import calibration_currents, with_measured_coil
    from eimi_lab.acquisition.event_words import on_terminal
    from eimi_lab.config.rig import load_rig
    from eimi_lab.process.outputs import refuse_existing, write_file
    from eimi_lab.process.progress import silent

    refuse_existing(output, force)
    bench_rig = load_rig(rig)
    measured = measure(bench_rig, calibration_currents(bench_rig, largest, steps), on_terminal(silent))
    calibration = with_measured_coil(bench_rig.calibration, measured, date.today())
    write_file(output, calibration.text, force)
    before, line = bench_rig.calibration.mT_per_A, measured.line
    lines = [f"{a:8.4g} A {b:10.5g} mT" for a, b in zip(measured.current_A, measured.field_mT, strict=True)]
    lines += [
        f"at the magnet, measured with {line.probe}: {line.in_words}; the calibration of the rig has {before:g} mT/A",
        (
            f"the standard deviation of the readings from the fitted straight line is {line.scatter_mT:.2g} mT; "
            f"readings with increasing and with decreasing current differ by at most {measured.hysteresis_mT:.2g} mT"
        ),
    ]
    if not line.shared_is_stated:
        lines.append(
            "the scale of the gaussmeter is assumed to be exact, because its table in the rig file has no "
            "uncertainty_share"
        )
    lines.append(f"{output}: the calibration with the measured field of the coil")
    return Result(
        lines,
        {
            "calibration": output,
            "coil_constant_mT_per_A": line.mT_per_A,
            "coil_constant_sigma_mT_per_A": line.mT_per_A_sigma,
            "offset_mT": line.offset_mT,
            "offset_sigma_mT": line.offset_mT_sigma,
            "current_A": measured.current_A.tolist(),
            "field_mT": measured.field_mT.tolist(),
        },
    )


def recover(
    crashed: Annotated[Path, typer.Argument(help="dataset of a run that crashed, or a damaged dataset")],
    output: Output,
    force: Force = False,
) -> Result:
    """Copy the stored states of a crashed run to a new dataset.

    A state is a load step with its frames. Damaged frames are left out. A damaged dataset of a finished run can also be
    recovered.
    """
    from eimi_lab.dataset.recovery import recover as copy_acknowledged

    states = copy_acknowledged(crashed, output, force)
    return Result([f"{output}: {states} states"], {"dataset": output, "states": states})
