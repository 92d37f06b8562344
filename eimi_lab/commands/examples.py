"""The examples at the end of the --help of each command."""

from __future__ import annotations

from collections.abc import Sequence

EXAMPLES = {
    "demo": ("eimi demo --quick", "eimi demo --material ecoflex_00_50 --specimen type2 -o demo_ecoflex"),
    "init": ("eimi init my_beam",),
    "instruments": ("eimi instruments",),
    "emulate": (
        "eimi emulate korad",
        "eimi emulate scpi --tcp 5025",
        "eimi emulate korad --fault shorted --after 20",
        "eimi emulate lakeshore-425 --coil TCPIP::127.0.0.1::42683::SOCKET --fault silence",
        "eimi emulate --faults",
    ),
    "acquire": (
        "eimi acquire dragon_skin_10 --specimen type1 --rig virtual -o run.h5",
        "eimi acquire protocol.toml --specimen specimen.toml --rig rig.toml --dry-run",
        "eimi acquire protocol.toml --specimen specimen.toml --rig rig.toml -o run.h5 --resume",
    ),
    "recover": ("eimi recover crashed.h5 -o run.h5",),
    "import": (
        "eimi import pictures/ --states states.csv --specimen specimen.toml --calibration calibration.toml -o run.h5",
        "eimi import run.mp4 --every 15 --states states.csv --specimen type1 --calibration calibration.toml -o run.h5",
        "eimi import points.csv --states states.csv --specimen specimen.toml --gravity-angle 0 -o run.h5",
    ),
    "calibrate": (
        "eimi calibrate --print-board",
        "eimi calibrate board_*.png --board charuco --coil-constant 4.7 --clamp-midpoint-px 640 80",
        "eimi calibrate rest.png --specimen specimen.toml --coil-constant 4.7 --clamp-midpoint-px 640 80",
    ),
    "calibrate-coil": ("eimi calibrate-coil --rig rig.toml -o calibration.toml",),
    "segment": ("eimi segment run.h5", "eimi segment run.h5 --channel red --overlay overlays --csv edges --workers 2"),
    "fit": (
        "eimi fit run.h5 --model neo-hookean -o fits.json",
        "eimi fit run_a.h5 run_b.h5 --model yeoh --model ogden --free roll=0.2 --workers 2 -o fits.json",
    ),
    "validate": ("eimi validate other.h5 --fit fits.json --by-state -o validation.json",),
    "tensile": ("eimi tensile curve.csv --model yeoh --window 50 --window full -o tensile.json",),
    "simulate": (
        "eimi simulate dragon_skin_10 --specimen type1 --model neo-hookean --parameter mu_Pa=46390 -o simulated",
        "eimi simulate dragon_skin_10 --specimen type1 --model yeoh --fit fits.json -o simulated",
    ),
    "export": ("eimi export fits.json --model yeoh --to abaqus --bulk-modulus-kPa 1000 -o yeoh.inp",),
    "plan": (
        "eimi plan fits.json dragon_skin_10 --specimen type1 --rig virtual --states 6 -o planned.toml",
        "eimi plan fits.json protocol.toml --specimen beam.toml --specimen thick.toml --rig rig.toml --gravity-angle 0 "
        "--gravity-angle 90 --tip-weight 0 --tip-weight 1 -o planned.toml",
    ),
    "discover": (
        "eimi discover run.h5 --tensile curve.csv -o discovery.json",
        "eimi discover run.h5 --tensile curve.csv --term i1 --term i2 --term gent=30 --term ogden=-4 -o discovery.json",
    ),
    "dashboard": ("eimi dashboard", "eimi dashboard my_runs"),
    "phone": ("eimi phone my_beam",),
    "study": ("eimi study --quick", "eimi study --tensile-data published_curves -o study"),
    "publish": (
        "eimi publish eimi-demo -o demo.eln",
        "eimi publish run.h5 fits.json report.html yeoh.inp --people people.toml --licence CC-BY-4.0 -o study.eln",
    ),
    "report": ("eimi report run.h5 --fit fits.json -o report.html",),
}


def in_help(examples: Sequence[str]) -> str:
    """Return the examples of a command as a text for --help."""
    # The control character keeps typer from joining the lines.
    return "\b\n" + "\n".join(["Examples:", *(f"  {example}" for example in examples)])
