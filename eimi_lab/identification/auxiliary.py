"""What a fit takes beside its datasets: nuisances that are freed, a free bulk modulus, tensile curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from eimi_fitting.nuisance import LARGEST, UNITS, Kind, Prior
from eimi_fitting.tensile_evidence import TensileCurve
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.tensile import check_windows, read_tensile

_WINDOW = "50"  # percent: more than beams bend to
_ROWS = 5  # of a tensile curve in its window; fewer say nothing of its noise


@dataclass(frozen=True)
class FileCurve(TensileCurve):
    """A tensile curve from a file, up to a largest strain (None: the whole curve)."""

    path: str = ""
    sha256: str = ""
    window_percent: float | None = None


@dataclass(frozen=True)
class Auxiliary:
    """Everything beside the datasets."""

    free: tuple[Prior, ...] = ()
    bulk: bool = False
    tensile: tuple[FileCurve, ...] = ()

    def options(self) -> dict[str, Any]:
        """As `eimi_fitting.identification.identify` takes them."""
        return {"free": self.free, "free_bulk": self.bulk, "tensile": self.tensile}

    def head(self) -> dict[str, Any]:
        """The same as a checkpoint writes it down."""
        return {
            "free": [f"{prior.kind}={prior.spread!r}" for prior in self.free] + ["bulk"] * self.bulk,
            "tensile": [[curve.sha256, curve.window_percent, curve.weight] for curve in self.tensile],
        }

    def check(self, evidence: Sequence[Evidence]) -> None:
        """Raises InputError where two datasets hold the same, or one knows nothing of what is to be freed."""
        known: dict[str, Path] = {}
        for seen in evidence:
            same = known.setdefault(seen.sha256, seen.path)
            if same != seen.path:
                raise InputError(f"{seen.path}: holds the same as {same}; the same data would count twice")
            if self.bulk and seen.experiment.model.specimen.section == "plane-stress":
                raise InputError(
                    f"--free bulk: {seen.path} is taken as plane-stress, which is exactly incompressible; "
                    "a bulk modulus takes plane-strain"
                )
            for prior in self.free:
                if prior.kind in ("moment", "coil") and not seen.experiment.loads.field_T.any():
                    raise InputError(f"--free {prior.kind}: {seen.path} has no state with a field")


def read_auxiliary(
    free: Sequence[str], tensile: Sequence[Path] = (), window: str | None = None, weight: float | None = None
) -> Auxiliary:
    """From `--free KEY=STANDARD_DEVIATION` or `--free bulk`, and tensile curves. Raises InputError."""
    for option, given in (("--tensile-window", window), ("--tensile-weight", weight)):
        if given is not None and not tensile:
            raise InputError(f"{option} {given}: of which curve? give --tensile too")
    priors: dict[Kind, Prior] = {}
    bulk = False
    for words in free:
        if words == "bulk":
            bulk = True
            continue
        prior = _prior(words)
        if prior.kind in priors:
            raise InputError(f"--free {words}: {prior.kind} is given twice")
        priors[prior.kind] = prior
    (percent,) = check_windows([_WINDOW if window is None else window], "--tensile-window")
    if weight is not None and not 0 < weight < float("inf"):
        raise InputError(f"--tensile-weight {weight:g}: should be a number above 0")
    curves = tuple(_windowed(path, percent, 1.0 if weight is None else weight) for path in tensile)
    for i, curve in enumerate(curves):
        for other in curves[:i]:
            if curve.sha256 == other.sha256:
                raise InputError(f"{curve.path}: holds the same as {other.path}; the same data would count twice")
    return Auxiliary(tuple(priors.values()), bulk, curves)


def _prior(words: str) -> Prior:
    key, equals, number = words.partition("=")
    for kind in get_args(Kind):
        if key == kind and equals:
            try:
                return Prior(kind, float(number))
            except ValueError as error:
                unit = {"1": "relative", "deg": "degrees"}.get(UNITS[kind], UNITS[kind])
                raise InputError(
                    f"--free {words}: should be {kind}=NUMBER above 0, at most {LARGEST[kind]:g} ({unit})"
                ) from error
    examples = "moment=0.02, coil=0.01 (relative), roll=0.1 (degrees), clamp=0.05 (mm)"
    raise InputError(f"--free {words}: should be a standard deviation such as {examples}, or bulk")


def _windowed(path: Path, percent: float | None, weight: float) -> FileCurve:
    test = read_tensile(path)
    inside = test.strain <= (float("inf") if percent is None else percent / 100)
    if inside.sum() < _ROWS:
        raise InputError(f"{path}: {inside.sum()} rows in the window; a fit needs at least {_ROWS}")
    return FileCurve(test.strain[inside], test.stress_Pa[inside], weight, str(path), test.sha256, percent)
