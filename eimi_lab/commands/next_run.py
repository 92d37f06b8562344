"""The command `plan`, which chooses the currents to measure in the next run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force


def plan(
    fits: Annotated[
        Path, typer.Argument(help="fits.json of an earlier run; the law and the noise in this file are used")
    ],
    protocol: Annotated[
        str,
        typer.Argument(
            help="protocol.toml whose limits, ramp (rate of the current) and settle (wait until the beam is at rest) "
            "the new protocol keeps"
        ),
    ],
    specimen: Annotated[
        list[str],
        typer.Option(
            metavar="FILE",
            help="specimen.toml, or the name of a specimen that comes with the program; repeat the option to compare "
            "specimens",
        ),
    ],
    rig: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="rig.toml, or the name of a rig that comes with the program; the uncertainties of the rig are used, "
            "and the smaller of the limits of the current in rig and protocol",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="file for the protocol of the best run")
    ],
    states: Annotated[
        int | None,
        typer.Option(
            help="number of states (currents) to choose", min=2, show_default="the number of states in PROTOCOL"
        ),
    ] = None,
    goal: Annotated[
        str,
        typer.Option(
            metavar="modulus|PARAMETER|LAW",
            help="aim of the run: to determine the modulus or a parameter of the law, or to distinguish the law from "
            "LAW, another law in fits.json",
        ),
    ] = "modulus",
    model: Annotated[
        str | None, typer.Option(metavar="LAW", help="law to use, if fits.json contains several laws")
    ] = None,
    gravity_angle: Annotated[
        list[float] | None,
        typer.Option(
            metavar="DEG",
            help="direction of gravity, from the axis of the straight beam: 0 for a beam that hangs down, 90 for a "
            "horizontal beam, 180 for an upright beam; repeat the option to compare directions",
            show_default="the direction in the rig",
        ),
    ] = None,
    tip_weight: Annotated[
        list[float] | None,
        typer.Option(
            metavar="GRAMS", help="weight at the tip; repeat the option to compare weights", min=0.0, show_default="0"
        ),
    ] = None,
    both_polarities: Annotated[
        bool,
        typer.Option("--both-polarities", help="also consider runs that repeat each state with the opposite current"),
    ] = False,
    force: Force = False,
) -> Result:
    """Propose the currents of the next run and write its protocol.

    The command prints a table of the possible runs, with the best run first. For each run, the table gives the expected
    result for --goal, such as the half-width of the 95 % interval of the modulus.
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
