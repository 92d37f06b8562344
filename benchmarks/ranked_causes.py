"""Print how often a fit ranks the true cause of its residuals first, from the records of many fits.

python -m benchmarks.ranked_causes FILE...

A cause is a property of the bench that differs from its files, such as a tilted camera. A file is written by
`benchmarks.imperfect_rigs --record FILE`. The table has one row for each true cause.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from eimi_fitting.inference.doubts.causes import NONE
from eimi_fitting.inference.identification.fit import Fit

_SHOWN = 3  # causes in a line of text
_HEAD = (
    *("imperfection", "fits", "true cause first", "or in its class", "largest wrong", "error of the modulus, %"),
    *("95 % interval, ± %", "holds", "doubted", "holds, or the doubt does"),
)


@dataclass(frozen=True)
class Entry:
    """A possible cause of the residuals of a fit, from `fits.json`.

    Attributes
    ----------
    name : str
        Name of the cause.
    probability : float
        Probability that the fit gives to the cause.
    value : float
        Size of the cause, in the unit of `fits.json`.
    shift_percent : float
        Change of the modulus if the cause is present, %.
    like : tuple of str
        Causes with nearly the same effect on the residuals, which the data cannot distinguish from this cause.
    is_within_stated : bool
        Whether the cause is an error of an input within its stated uncertainty.
    """

    name: str
    probability: float
    value: float
    shift_percent: float
    like: tuple[str, ...]
    is_within_stated: bool = False


@dataclass(frozen=True)
class Ranked:
    """A fit to simulated data with known errors, such as a tilted camera, and the possible causes of its residuals.

    Attributes
    ----------
    cause : str
        True cause, or two true causes joined by ``+``.
    seed : int
        Seed of the noise.
    shape : str
        Shape at rest in the fit: "straight" or "measured".
    error_percent : float
        Error of the modulus, %.
    interval_percent, interval_fit_percent : tuple of float
        95 % intervals of the error: from all stated uncertainties, and from noise and mesh alone.
    doubted_percent : tuple of float or None
        Smallest and largest change of the modulus by a cause that a warning names, %.
    doubts : int
        Number of warnings.
    causes : tuple of Entry
        Possible causes, the most probable first.
    """

    cause: str
    seed: int
    shape: str
    error_percent: float
    interval_percent: tuple[float, float]
    interval_fit_percent: tuple[float, float]
    doubted_percent: tuple[float, float] | None
    doubts: int
    causes: tuple[Entry, ...]

    @staticmethod
    def of(fit: Fit, cause: str, seed: int, shape: str, true_Pa: float) -> Ranked:
        # Return the result of a fit to a bench with the simulated error ``cause``, or with two, joined by ``+``.
        def percent(ends: tuple[float, float]) -> tuple[float, float]:
            low, high = (100 * (end / true_Pa - 1) for end in ends)
            return low, high

        modulus = fit.initial_shear_modulus
        return Ranked(
            cause,
            seed,
            shape,
            100 * (modulus.value / true_Pa - 1),
            percent(modulus.interval_95),
            percent(modulus.interval_95_fit or modulus.interval_95),
            next((doubt.modulus_percent for doubt in fit.doubts if doubt.modulus_percent), None),
            len(fit.doubts),
            tuple(
                Entry(c.name, c.probability, c.value, c.shift_percent, c.like, c.is_within_stated) for c in fit.causes
            ),
        )

    def as_json(self) -> str:
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(line: str) -> Ranked:
        stored = json.loads(line)
        doubted = stored.pop("doubted_percent")
        causes = tuple(Entry(**{**entry, "like": tuple(entry["like"])}) for entry in stored.pop("causes"))
        pairs = {key: tuple(stored.pop(key)) for key in ("interval_percent", "interval_fit_percent")}
        return Ranked(**stored, **pairs, doubted_percent=tuple(doubted) if doubted else None, causes=causes)

    @property
    def true(self) -> frozenset[str]:
        """The names of the true causes of the residuals, one or two."""
        return frozenset(self.cause.split("+"))

    @property
    def is_first(self) -> bool:
        """Whether the true cause is the most probable one; of two true causes, whether both are in the first two."""
        return self.true <= {entry.name for entry in self.causes[: len(self.true)]}

    @property
    def is_second(self) -> bool:
        """Whether the true cause is among the first two; of two true causes, whether both are in the first three."""
        return self.true <= {entry.name for entry in self.causes[: len(self.true) + 1]}

    @property
    def is_in_first_class(self) -> bool:
        """Whether the true cause is the most probable one, or one that the data cannot distinguish from it."""
        return self.is_first or self._is_in_first_classes(len(self.true))

    @property
    def is_in_first_two_classes(self) -> bool:
        """Whether the true cause is one of the two most probable ones, or the data cannot tell it from one of them."""
        return self.is_second or self._is_in_first_classes(len(self.true) + 1)

    def _is_in_first_classes(self, count: int) -> bool:
        # A class contains causes that the data cannot distinguish. If there are two true causes, each must be in a
        # class.
        classes = list(dict.fromkeys(frozenset({entry.name, *entry.like}) for entry in self.causes))[:count]
        return sum(bool(self.true & members) for members in classes) >= len(self.true)

    @property
    def wrong(self) -> float:
        """Largest probability that the fit gives to a cause that is not present."""
        return max((e.probability for e in self.causes if e.name not in self.true and e.name != NONE), default=0.0)

    @property
    def holds(self) -> bool:
        """Whether the 95 % interval from all stated uncertainties contains the true modulus."""
        low, high = self.interval_percent
        return low <= 0 <= high

    @property
    def is_said(self) -> bool:
        # Whether the 95 % interval contains the true modulus, if necessary after it was shifted as a warning says.
        if self.holds or self.doubted_percent is None:
            return self.holds
        least, most = self.doubted_percent
        low, high = self.interval_percent
        return low + least <= 0 <= high + most

    def in_words(self) -> str:
        """Return two lines: the error of the modulus with its 95 % intervals, and the three most probable causes."""
        low, high = self.interval_percent
        ends = self.interval_fit_percent
        doubt = "no doubt that names a cause"
        if self.doubted_percent:
            least, most = self.doubted_percent
            doubt = f"doubted by {least:+.2f} to {most:+.2f} %"
        names = [entry.name for entry in self.causes]
        place = " and ".join(str(names.index(one) + 1) if one in names else "-" for one in self.cause.split("+"))
        first = ", ".join(f"{e.name} {e.probability:.2f} ({e.value:+.3g})" for e in self.causes[:_SHOWN])
        alike = f"; like {names[0]}: {', '.join(self.causes[0].like)}" if names and self.causes[0].like else ""
        return (
            f"{self.cause:19s} seed {self.seed}  {self.shape}: {self.error_percent:+7.2f} % [{ends[0]:+6.2f}, "
            f"{ends[1]:+6.2f}]  ±{(high - low) / 2:5.2f} % {'holds' if self.holds else 'MISSES'}, {doubt}\n"
            f"{'':19s} place {place}: {first}{alike}"
        )


def summary(results: Sequence[Ranked]) -> str:
    # Return lines that say how many fits named the simulated bench error or another, or hold the true modulus.
    counts = {
        "first": sum(one.is_first for one in results),
        "first or second": sum(one.is_second for one in results),
        "first or in its class": sum(one.is_in_first_class for one in results),
        "in the first two classes": sum(one.is_in_first_two_classes for one in results),
        "with a wrong cause above 0.9": sum(one.wrong > 0.9 for one in results),
        "hold the truth, or the doubt names the change": sum(one.is_said for one in results),
    }
    return "\n".join(f"{count} of {len(results)} {words}" for words, count in counts.items())


def table(results: Sequence[Ranked]) -> str:
    # Return a Markdown table with a row for each simulated bench error. The row says how many fits named it, and gives
    # the errors of the modulus and the number of warnings.
    lines = [_cells(_HEAD), _cells(["---"] * len(_HEAD))]
    for cause in dict.fromkeys(one.cause for one in results):
        some = [one for one in results if one.cause == cause]
        errors = sorted(one.error_percent for one in some)
        widths = sorted((one.interval_percent[1] - one.interval_percent[0]) / 2 for one in some)
        cells = (
            cause.replace("+", " and ").replace("_", " "),
            str(len(some)),
            *(str(sum(flags)) for flags in ([o.is_first for o in some], [o.is_in_first_class for o in some])),
            f"{max(one.wrong for one in some):.2f}",
            f"{errors[0]:+.2f} to {errors[-1]:+.2f}",
            f"{widths[0]:.1f} to {widths[-1]:.1f}",
            str(sum(one.holds for one in some)),
            str(sum(one.doubted_percent is not None for one in some)),
            str(sum(one.is_said for one in some)),
        )
        lines.append(_cells(cells))
    return "\n".join(lines)


def _cells(words: Sequence[str]) -> str:
    return f"| {' | '.join(words)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    lines = [line for path in parser.parse_args().files for line in path.read_text(encoding="utf-8").splitlines()]
    results = list({(one.cause, one.seed, one.shape): one for one in map(Ranked.from_json, lines)}.values())
    print(f"{table(results)}\n\n{summary(results)}")


if __name__ == "__main__":
    main()
