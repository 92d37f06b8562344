"""The command `plan`, which chooses the states to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force


def plan(
    fits: Annotated[Path, typer.Argument(help="fits.json of an earlier run; its law and its noise are used")],
    protocol: Annotated[str, typer.Argument(help="protocol.toml whose limits, ramp and settling are used again")],
    specimen: Annotated[
        list[str],
        typer.Option(
            metavar="FILE", help="specimen.toml, or the name of a shipped specimen; repeat it to compare several"
        ),
    ],
    rig: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="rig.toml, or the name of a shipped rig; its limits and uncertainties are used"
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="protocol to write")],
    states: Annotated[
        int | None, typer.Option(help="number of states", min=2, show_default="as many as PROTOCOL has")
    ] = None,
    goal: Annotated[
        str,
        typer.Option(
            metavar="modulus|PARAMETER|LAW",
            help="the modulus or the parameter to determine best, or the law to rule out",
        ),
    ] = "modulus",
    model: Annotated[str | None, typer.Option(metavar="LAW", help="law to use, if fits.json holds several")] = None,
    gravity_angle: Annotated[
        list[float] | None,
        typer.Option(
            metavar="DEG",
            help="direction of gravity in the beam frame: 0 hanging, 90 level, 180 upright; repeat it to compare "
            "several",
            show_default="that of the rig",
        ),
    ] = None,
    tip_weight: Annotated[
        list[float] | None,
        typer.Option(
            metavar="GRAMS", help="weight at the tip; repeat it to compare several", min=0.0, show_default="0"
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Choose the states to measure next and write their protocol.

    The table lists the possible runs and what each is expected to achieve, best first.
    """
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.fits import planning
    from eimi_lab.fits.fits_file import read_any_fits
    from eimi_lab.process.outputs import check_distinct, refuse_existing, write_file

    inputs = dict.fromkeys([fits, *map(Path, (protocol, rig, *specimen))])  # a specimen and a rig may have one name
    check_distinct(list(inputs), [output])
    base, bench, beams = load_protocol(protocol), load_rig(rig), [load_specimen(name) for name in specimen]
    refuse_existing(output, force)
    aim = planning.Goal.of(fits, read_any_fits(fits), model, goal)
    choice = planning.mountings(beams, bench, gravity_angle or [], tip_weight or [])
    runs = planning.plan(aim, choice, bench, base, states or len(base.currents_A))
    write_file(output, planning.protocol_text(aim, runs[0], base), force)
    return Result([*planning.table(aim, runs), output], planning.content(aim, runs))
