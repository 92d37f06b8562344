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
    both_polarities: Annotated[
        bool,
        typer.Option(
            "--both-polarities", help="consider also runs that repeat each state with the current of the coil reversed"
        ),
    ] = False,
    force: Force = False,
) -> Result:
    """Choose the states to measure next and write their protocol.

    The table lists the possible runs and what each is expected to achieve, best first.
    """
    from eimi_lab.face.using import plan as plan_run
    from eimi_lab.fits import planning

    planned = plan_run(
        fits,
        protocol,
        specimen,
        rig,
        states=states,
        goal=goal,
        model=model,
        gravity_angle=gravity_angle or (),
        tip_weight=tip_weight or (),
        both_polarities=both_polarities,
        output=output,
        force=force,
    )
    return Result([*planning.table(planned.goal, planned.runs), output], planning.content(planned.goal, planned.runs))
