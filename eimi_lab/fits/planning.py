"""Plan the next run: choose states, mounting and specimen for a goal, within the limits of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.supplies.supply_names import is_bipolar
from eimi_drivers.supplies.values import set_point_text
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import STANDARD_GRAVITY
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.planning.design_of_experiment import (
    MODULUS,
    Candidates,
    EdgeNoise,
    KnownLaw,
    candidates,
)
from eimi_fitting.inference.planning.exchange import equally_spaced, exchange
from eimi_fitting.inference.planning.rival_laws import Rivals, rivals
from eimi_fitting.laws import LAWS
from eimi_lab.config.protocol import Currents, Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.rig_uncertainty import stated_by_rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import to_toml
from eimi_lab.fits.evidence import FEWEST_STATES
from eimi_lab.fits.fits_file import AnyFit
from eimi_lab.fits.planned_ring_down import ExpectedRingDown, expected_ring_down
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.field_at_beam import in_stated_field

Array = NDArray[np.float64]

_GRID = 41  # currents among which the states are chosen


@dataclass(frozen=True)
class Mounting:
    """The specimen of a planned run, the direction of gravity, the weight at the tip, and the signs of the current.

    Attributes
    ----------
    specimen : SpecimenFile
        Beam and magnet.
    gravity_angle_deg : float or None
        Angle of gravity in the beam frame; None without gravity.
    tip_weight_g : float
        Weight at the tip.
    both_polarities : bool
        Whether each current is repeated with the opposite sign.
    """

    specimen: SpecimenFile
    gravity_angle_deg: float | None
    tip_weight_g: float
    both_polarities: bool = False

    @property
    def tip_force_N(self) -> float:
        """Return the force in N of the weight that hangs from the tip."""
        return 1e-3 * STANDARD_GRAVITY * self.tip_weight_g

    def in_words(self) -> str:
        """Return a text with specimen, direction of gravity, weight at the tip, and the signs of the current."""
        gravity = "no gravity" if self.gravity_angle_deg is None else f"gravity at {self.gravity_angle_deg:g}°"
        weight = f", {self.tip_weight_g:g} g at the tip" if self.tip_weight_g else ""
        both = ", both polarities" if self.both_polarities else ""
        return f"{self.specimen.specimen.name}, {gravity}{weight}{both}"


@dataclass(frozen=True)
class PlannedRun:
    """The chosen states (load steps) of a run, compared with the same number of equally spaced states.

    Attributes
    ----------
    mounting : Mounting
        Specimen, gravity and tip weight.
    currents_A : tuple of float
        Currents of the chosen states. If the run has both signs, only the positive currents are listed.
    expected, spaced : float
        Expected half-width (%) of the 95 % interval, or expected difference of AIC between two laws: for the chosen
        states, and for equally spaced states.
    effects_percent : dict of float
        By uncertain input: resulting standard deviation (%) of the modulus or parameter.
    signed_percent : dict of float
        By uncertain input: change (%) of the modulus or parameter for one standard uncertainty.
    ring_down : ExpectedRingDown or None
        Intervals of the modulus with a ring-down (free vibration), if computed.
    """

    mounting: Mounting
    currents_A: tuple[float, ...]
    expected: float
    spaced: float
    effects_percent: dict[str, float]
    signed_percent: dict[str, float] = field(default_factory=dict)
    ring_down: ExpectedRingDown | None = None


@dataclass(frozen=True)
class Goal:
    """The goal of a run: to measure the modulus or a parameter of a law, or to distinguish the law from a rival law."""

    fit: FitRecord
    parameter: str = MODULUS
    rival: FitRecord | None = None

    @staticmethod
    def of(path: Path, fits: Sequence[AnyFit], model: str | None, words: str) -> Goal:
        """Return the goal of a plan, which the options `--goal` and `--model` specify.

        Parameters
        ----------
        path : Path
            Fits file, for messages.
        fits : sequence of FitRecord or TensileRecord
            Fits of the file.
        model : str or None
            Name of the law; None if the file holds one law.
        words : str
            What the run is to determine: `modulus`, or the name of a parameter of the law. The name of another law of
            the file means that the run is to distinguish the two laws.

        Raises
        ------
        InputError
            If no fit to a bending beam matches, or if the goal does not exist.
        """
        bending = {fit.model: fit for fit in fits if isinstance(fit, FitRecord)}
        if not bending:
            raise InputError(f"{path}: holds no fit to a bending beam; a plan needs the noise of such a fit")
        if model is None and len(bending) > 1:
            raise InputError(f"{path}: holds several laws; give --model with one of {', '.join(bending)}")
        fit = bending.get(model or next(iter(bending)))
        if fit is None:
            raise InputError(f"{path}: --model {model}: should be one of {', '.join(bending)}")
        if words == "modulus":
            return Goal(fit)
        if words in fit.parameters:
            return Goal(fit, words)
        if words in bending and words != fit.model:
            return Goal(fit, rival=bending[words])
        others = ", ".join(name for name in bending if name != fit.model)
        raise InputError(
            f"{path}: --goal {words}: should be modulus, one of {fit.model}'s parameters ({', '.join(fit.parameters)})"
            + (f", or another law of the file ({others})" if others else "")
        )

    def in_words(self) -> str:
        """Return the heading of a table column with the expected results, with unit."""
        if self.rival:
            return f"comparison of {self.fit.model} with {self.rival.model}, expected difference of AIC"
        return f"{self.parameter} of {self.fit.model}, expected half-width of the 95 % interval"

    def value(self, number: float) -> str:
        """Return the expected result of a planned run, difference of AIC or half-width in per cent, as text."""
        return f"{number:.3g}" if self.rival else f"± {number:.3g} %"


def mountings(
    specimens: Sequence[SpecimenFile],
    rig: Rig,
    gravity_angles: Sequence[float],
    weights: Sequence[float],
    both_polarities: bool,
) -> list[Mounting]:
    """Return a mounting for each combination of specimen, angle of gravity and weight at the tip.

    Parameters
    ----------
    specimens : sequence of SpecimenFile
        Available specimens.
    rig : Rig
        Rig file, with the default angle of gravity.
    gravity_angles : sequence of float
        Angles of gravity in the beam frame in degrees; if empty, that of the rig.
    weights : sequence of float
        Weights at the tip in grams; if empty, no weight.
    both_polarities : bool
        Whether runs with both signs of the current are also considered.

    Raises
    ------
    InputError
        If weights or angles are given for a rig without gravity.
    """
    gravity = rig.calibration.gravity
    if not gravity and (any(weights) or gravity_angles):
        raise InputError(f"rig {rig.name}: calibration has gravity = false: leave out --tip-weight and --gravity-angle")
    angles: Sequence[float | None] = gravity_angles or [round(BeamFrame(rig.calibration).gravity_deg, 3)]
    return [
        Mounting(specimen, angle if gravity else None, weight, both)
        for specimen in specimens
        for angle in angles
        for weight in weights or [0.0]
        for both in ((False, True) if both_polarities else (False,))
    ]


def number_of_states(given: int | None, protocol: Protocol, both_polarities: bool) -> int:
    """Return the number of states (load steps) of a plan: the given number, or the number of the protocol.

    A run with both signs of the current has an even number of states. If the number of the protocol is odd, such a run
    has one state less.

    Raises
    ------
    InputError
        If the number is too small, or if the given number is odd although both signs of the current are considered.
    """
    states = len(protocol.currents_A) if given is None else given
    if states < FEWEST_STATES:
        raise InputError(f"--states {states}: should be at least {FEWEST_STATES}")
    if both_polarities and (states < 2 * FEWEST_STATES or (given is not None and states % 2)):
        raise InputError(
            f"--states {states}: with --both-polarities, should be an even number, at least {2 * FEWEST_STATES}"
        )
    return states


def plan(goal: Goal, choices: Sequence[Mounting], rig: Rig, protocol: Protocol, states: int) -> list[PlannedRun]:
    """Choose the best states (load steps) for a goal in each mounting.

    Parameters
    ----------
    goal : Goal
        Quantity to determine, or two laws to distinguish.
    choices : sequence of Mounting
        Mountings to compare.
    rig : Rig
        Rig file, with the limits and uncertainties of the instruments.
    protocol : Protocol
        Additional limits.
    states : int
        Number of states.

    Returns
    -------
    list of PlannedRun
        Best run first.

    Raises
    ------
    InputError
        If there are too few currents to choose from, or if the beam has an equilibrium in too few states.
    """
    currents = _currents(rig, protocol)
    if states > len(currents):
        raise InputError(f"--states {states}: should be at most {len(currents)}, the number of currents to choose from")
    runs = [run for mounting in choices if (run := _planned(goal, mounting, rig, currents, states))]
    if not runs:
        raise InputError(
            "the beam has a stable equilibrium at too few of the currents: set a lower current limit in the "
            "protocol, or choose another specimen, direction of gravity or weight at the tip"
        )
    best, *others = sorted(runs, key=lambda run: run.expected, reverse=goal.rival is not None)
    return [_with_ring_down(goal, best, rig), *others]


def _with_ring_down(goal: Goal, run: PlannedRun, rig: Rig) -> PlannedRun:
    """Return a planned run with the expected intervals of the modulus after an added ring-down (free vibration)."""
    if goal.rival or goal.parameter != MODULUS:
        return run
    mounting = run.mounting
    expected = expected_ring_down(
        _law(goal.fit),
        mounting.specimen.mechanics(),
        mounting.gravity_angle_deg,
        mounting.tip_force_N,
        _stated(mounting, rig),
        run.expected,
        run.signed_percent,
    )
    return replace(run, ring_down=expected)


def _stated(mounting: Mounting, rig: Rig) -> tuple[StatedSource, ...]:
    return (
        *mounting.specimen.stated_sources(),
        *rig.calibration.stated_sources(),
        *stated_by_rig(rig.text, rig.name, rig.calibration.mT_per_A),
    )


def _currents(rig: Rig, protocol: Protocol) -> Array:
    limit = protocol.limits.stricter(rig.supply.limits).current_A
    bipolar = not rig.simulated and is_bipolar(rig.supply.driver)
    rounded = np.round(np.linspace(-limit if bipolar else 0.0, limit, _GRID), 3)
    # A run refuses currents between the steps of its supply.
    step = rig.current_step_A
    possible = np.clip(rounded, -limit, limit)
    return np.unique(possible if step is None else [float(set_point_text(current, step)) for current in possible])


def _planned(goal: Goal, mounting: Mounting, rig: Rig, currents_A: Array, states: int) -> PlannedRun | None:
    constant = rig.calibration.mT_per_A
    if mounting.both_polarities:
        currents_A, states = currents_A[currents_A > 0], states // 2
    loads = Loads.along(
        constant * (np.concatenate([currents_A, -currents_A]) if mounting.both_polarities else currents_A),
        BeamFrame(rig.calibration).field_deg,
        mounting.gravity_angle_deg,
        mounting.tip_force_N,
    )
    loads = in_stated_field(loads, rig.calibration, mounting.specimen.mechanics())
    stated = _stated(mounting, rig)
    specimen = mounting.specimen.mechanics()
    law, noise = _law(goal.fit), _noise(goal.fit)
    criterion: Candidates | Rivals
    try:
        if goal.rival:
            criterion = rivals(law, _law(goal.rival), specimen, loads, stated, noise)
        else:
            criterion = candidates(law, specimen, loads, stated, noise, goal.parameter)
        if mounting.both_polarities:
            criterion = _in_pairs(criterion, len(currents_A))
        choice = exchange(criterion, states)
    except ValueError:  # the beam has an equilibrium in too few states
        return None
    spaced = equally_spaced(len(criterion), states)
    score = criterion.apart if isinstance(criterion, Rivals) else criterion.half_width_percent
    return PlannedRun(
        mounting=mounting,
        currents_A=tuple(currents_A[criterion.states[choice]].tolist()),
        expected=score(choice),
        spaced=score(spaced),
        effects_percent=criterion.effects_percent(choice) if isinstance(criterion, Candidates) else {},
        signed_percent=criterion.signed_effects_percent(choice) if isinstance(criterion, Candidates) else {},
    )


def _in_pairs(criterion: Candidates | Rivals, currents: int) -> Candidates | Rivals:
    """Return a criterion for the choice of states, in which states at opposite currents are chosen as one pair.

    `currents` is the number of positive currents; the states are in the order I, then -I. Raises ValueError for fewer
    than two pairs.
    """
    place = {int(state): k for k, state in enumerate(criterion.states)}
    pairs = [(place[i], place[i + currents]) for i in range(currents) if i in place and i + currents in place]
    if len(pairs) < FEWEST_STATES:
        raise ValueError(
            f"the beam has a stable equilibrium at both signs of the current for {len(pairs)} currents; at least "
            f"{FEWEST_STATES} are needed"
        )
    first, second = np.array(pairs).T
    if isinstance(criterion, Rivals):
        sums = {name: getattr(criterion, name) for name in ("square", "score", "normal")}
        of_both: dict[str, Any] = {name: values[first] + values[second] for name, values in sums.items()}
        return replace(criterion, loads=criterion.loads.take(first), states=criterion.states[first], **of_both)
    return replace(
        criterion,
        loads=criterion.loads.take(first),
        states=criterion.states[first],
        normal=criterion.normal[first] + criterion.normal[second],
        source_score=criterion.source_score[first] + criterion.source_score[second],
        points=2 * criterion.points,
    )


def _law(fit: FitRecord) -> KnownLaw:
    return KnownLaw(LAWS[fit.model], np.array(fit.values()))


def _noise(fit: FitRecord) -> EdgeNoise:
    section_percent = fit.section_change.left_percent if fit.section_change else None
    return EdgeNoise.of(fit.identifiability, len(fit.by_state), section_percent or 0.0)


def protocol_text(goal: Goal, run: PlannedRun, protocol: Protocol) -> str:
    """Return the planned states as a protocol in TOML."""
    both = {"both_polarities": True} if run.mounting.both_polarities else {}
    states = Currents(values_A=run.currents_A, **both)
    changed = protocol.model_copy(
        update={"name": f"{protocol.name}-planned", "current": states, "tip_force_N": run.mounting.tip_force_N}
    )
    return (
        f"# Planned for the goal: {goal.in_words()}: {goal.value(run.expected)}; with equally spaced currents: "
        f"{goal.value(run.spaced)}\n# Mounting: {run.mounting.in_words()} (direction of gravity in degrees: 0 hangs "
        "down, 90 is level, 180 is upright)\n"
    ) + to_toml(changed)


def table(goal: Goal, runs: Sequence[PlannedRun]) -> list[str]:
    """Return the lines of a table of the planned runs, the best first."""
    width = max(len(run.mounting.in_words()) for run in runs)
    lines = [goal.in_words(), f"{'mounting':{width}}  {'planned':>10}  {'equally spaced':>14}"]
    for run in runs:
        lines.append(f"{run.mounting.in_words():{width}}  {goal.value(run.expected):>10}  {goal.value(run.spaced):>14}")
    best = runs[0]
    lines.append(f"best run: {best.mounting.in_words()}, currents {', '.join(f'{a:g}' for a in best.currents_A)} A")
    effects = [f"{name} {effect:.2g} %" for name, effect in list(best.effects_percent.items())[:3] if effect > 0]
    if effects:
        lines.append(
            "largest sources of uncertainty, each with the standard deviation of the modulus that it causes: "
            f"{', '.join(effects)}"
        )
    if best.ring_down:
        lines.append(best.ring_down.in_words)
    return lines


def content(goal: Goal, runs: Sequence[PlannedRun]) -> dict[str, Any]:
    """Return the goal and the planned runs as a dictionary for JSON."""
    return {
        "goal": goal.in_words(),
        "runs": [
            {
                "specimen": run.mounting.specimen.specimen.name,
                "gravity_angle_deg": run.mounting.gravity_angle_deg,
                "tip_weight_g": run.mounting.tip_weight_g,
                "both_polarities": run.mounting.both_polarities,
                "currents_A": run.currents_A,
                "expected": run.expected,
                "equally_spaced": run.spaced,
                "effects_percent": run.effects_percent,
                "ring_down": run.ring_down and asdict(run.ring_down),
            }
            for run in runs
        ],
    }
