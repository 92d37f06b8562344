"""The command that says what to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force


def plan(
    fits: Annotated[Path, typer.Argument(help="fits.json of an earlier run: its law, its noise")],
    protocol: Annotated[str, typer.Argument(help="protocol.toml whose limits, ramp and settling the new one takes")],
    specimen: Annotated[list[str], typer.Option(help="specimen.toml or a shipped one; repeat it to have a choice")],
    rig: Annotated[str, typer.Option(help="rig.toml, or a shipped one such as virtual: its limits and uncertainties")],
    output: Annotated[Path, typer.Option("-o", "--output", help="the protocol to write")],
    states: Annotated[int | None, typer.Option(help="number of states [as many as the protocol has]", min=2)] = None,
    goal: Annotated[
        str, typer.Option(metavar="modulus|PARAMETER|LAW", help="narrow one of them down, or rule a law out")
    ] = "modulus",
    model: Annotated[str | None, typer.Option(help="which law of fits.json, where there are several")] = None,
    gravity_angle: Annotated[
        list[float] | None,
        typer.Option(help="mountings to choose from, in the beam frame: 0 hangs, 90 level, 180 upright [the rig's]"),
    ] = None,
    tip_weight: Annotated[
        list[float] | None, typer.Option(help="weights at the tip to choose from, in grams [0]", min=0.0)
    ] = None,
    force: Force = False,
) -> Result:
    """Which states to measure next, and how narrow an interval to expect; writes the protocol of the best run."""
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.fits import planning
    from eimi_lab.fits.fits_file import read_any_fits
    from eimi_lab.process.outputs import check_distinct, refuse_existing, write_file

    given = dict.fromkeys([fits, *map(Path, (protocol, rig, *specimen))])  # a specimen and a rig may have one name
    check_distinct(list(given), [output])
    base, bench, beams = load_protocol(protocol), load_rig(rig), [load_specimen(name) for name in specimen]
    refuse_existing(output, force)
    aim = planning.Goal.of(fits, read_any_fits(fits), model, goal)
    choice = planning.mountings(beams, bench, gravity_angle or [], tip_weight or [])
    runs = planning.plan(aim, choice, bench, base, states or len(base.currents_A))
    write_file(output, planning.protocol_text(aim, runs[0], base), force)
    return Result([*planning.table(aim, runs), output], planning.content(aim, runs))
