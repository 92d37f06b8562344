"""Identify the viscoelastic (Prony) law of a beam from recorded motions and static shapes."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.channels import TooFewFrames, signals_of
from eimi_fitting.time.decay import Decay, NoVibration, decay_of
from eimi_fitting.time.evidence import Evidence, RestEvidence, RingEvidence, Sag, with_scatter
from eimi_fitting.time.exposure import without_blur
from eimi_fitting.time.law_of_time import (
    EXACT_LOAD,
    FREE_LOAD,
    LOAD_SOURCES,
    Problem,
    TimeOptimum,
    best_number_of_terms,
    drawn,
    relative_load_sigmas,
)
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.result import LawOfTime, result_of
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import NoEquilibrium, RingingBeam
from eimi_fitting.time.slow_evidence import CreepEvidence, LoadHistory, SlowEvidence, StaticEvidence
from eimi_fitting.time.slow_motion import (
    displacement_per_rad,
    modulus_in_pictures,
    shown_rotations,
    slow_rotations,
)
from eimi_fitting.time.terms import Terms

Array = NDArray[np.float64]

_MOST_TERMS = 4
_MOST_CREEP_ROWS = 6  # the records of creep with the largest rotations are used, at most this many
_LONGEST_S = 30.0  # the relaxation times reach at least this far, because silicones relax for so long
_SECTION_CHANGE = 0.02  # a larger relative change of the modulus, from a planar section to a solid, causes a doubt
_MOST_STEPS = 3  # changes of the load before a motion that are used


class NoRingDown(Exception):
    """No recorded motion of the beam shows a decaying vibration."""


@dataclass(frozen=True)
class RecordedMotion:
    """A recorded motion of a beam, with the loads on the beam."""

    # The measured positions of points over time.
    motion: Motion
    # The loads after the step of the load.
    loads: Loads
    # Earlier loads, each with the time in s at which it began, relative to the step.
    before: tuple[tuple[float, Loads], ...] = ()

    @property
    def is_stepped(self) -> bool:
        """Whether the motion begins with a known change of the load."""
        return bool(self.before) and not _same(self.before[-1][1], self.loads)


@dataclass(frozen=True)
class StaticRun:
    """Static shapes of a beam under several constant loads."""

    # The loads of K states.
    loads: Loads
    # `set_s`, `seen_s` (K,): times at which each load was set, and at which the edges were measured.
    set_s: Array
    seen_s: Array


@dataclass(frozen=True)
class StaticStates:
    """Static shapes of a beam, and the shear modulus of an elastic fit to them."""

    # The shapes, in runs of the bench.
    runs: tuple[StaticRun, ...]
    # Initial shear modulus of the elastic fit.
    modulus_Pa: float
    # Relative standard uncertainty of the modulus due to noise and mesh.
    sigma: float
    # Relative change of the modulus by errors of the picture, such as the scale.
    of_picture: Mapping[str, float]


def identify_time(
    law: Law,
    shape: Array,
    specimen: Specimen,
    motions: Sequence[RecordedMotion],
    stated: Sequence[StatedSource] = (),
    static: StaticStates | None = None,
    *,
    seed: int = 1,
    free_times: bool = True,
    most_terms: int = _MOST_TERMS,
) -> LawOfTime:
    """Identify a shear modulus and a Prony series from free vibrations, creep and static shapes.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    shape : ndarray
        The parameters of the law. Only the ratios between the moduli are used.
    specimen : Specimen
        The specimen of all motions.
    motions : sequence of RecordedMotion
        The recorded motions.
    stated : sequence of StatedSource
        Inputs with their standard uncertainties, such as the width.
    static : StaticStates, optional
        Static shapes of the specimen under constant loads.
    seed : int
        Seed of the random numbers.
    free_times : bool
        Whether to fit the relaxation times. Otherwise they are fixed, at equal distances on a logarithmic scale.
    most_terms : int
        Largest number of terms of the Prony series.

    Returns
    -------
    LawOfTime
        The modulus and the Prony series, with their uncertainty.

    Raises
    ------
    NoRingDown
        No motion shows a decaying vibration.
    NoEquilibrium
        No shear modulus gives the measured frequency of the beam.
    """
    began = time.perf_counter()
    is_modulus = np.array([unit == "Pa" for unit in law.units])
    modulus = float(law.initial_shear_modulus(shape))
    unit_shape = np.where(is_modulus, shape / modulus, shape)
    analysed, doubts = _analysed(motions, specimen)
    ringing = [(recorded, decay) for recorded, decay in analysed if decay is not None]
    # Ring-downs without a field come first: their modulus does not depend on the moment, and the result states it.
    ringing.sort(key=lambda one: bool(np.any(one[0].loads.field_T)))
    if not ringing:
        raise NoRingDown("; ".join(doubts) or "no recorded motion is given, but at least one ring-down is needed")
    tables: list[RingTable] = []
    rings = []
    for recorded, decay in ringing:
        table = _table_for(recorded, decay, tables, RingingBeam(
            specimen, recorded.loads, law, unit_shape, recorded.motion.hanging_N
        ))  # fmt: skip
        rings.append(RingEvidence.of(table, decay, recorded.is_stepped))
        doubts += decay.doubts
    doubts += _doubts_of_section(rings[0].table)
    rings = list(with_scatter(rings))
    middle_Pa = rings[0].table.middle_Pa
    creeps = _creeps(analysed, specimen, law, unit_shape, middle_Pa)
    of_states = _static_evidence(static, specimen, law, unit_shape)
    evidence: list[Evidence] = [*rings]
    if creeps or of_states:
        evidence.append(SlowEvidence(creeps, of_states))
    for table in tables:
        rest, of_sag = _at_rest(ringing, table, rings)
        evidence += [rest] if rest else []
        doubts += of_sag
    has_loads = bool(specimen.magnet and (of_states or creeps))
    load_sigmas = relative_load_sigmas(stated, specimen) if has_loads else {}
    load_sigma = (
        FREE_LOAD if load_sigmas is None else max(float(np.hypot.reduce([0.0, *load_sigmas.values()])), EXACT_LOAD)
    )
    data_s = _range_s(rings, creeps, of_states)
    range_s = data_s[0], max(data_s[1], _LONGEST_S)
    problems = [
        Problem(Terms(count, range_s, middle_Pa, free_times), tuple(evidence), load_sigma)
        for count in range(1, most_terms + 1)
    ]
    best, optima = best_number_of_terms(problems, seed)
    sources = {
        s.source: s.standard_uncertainty
        for s in stated
        if s.standard_uncertainty and not (has_loads and s.source in LOAD_SOURCES)
    }
    effects = best.problem.effects(sources)
    steps = best.steps(effects)
    omegas = 2 * np.pi * np.unique([mode.frequency_Hz for ring in rings for _, mode in ring.modes])
    if not best.converged:
        doubts.append(
            "the final least-squares fit of the viscoelastic law did not converge; the values may not be the optimum"
        )
    return result_of(
        specimen=specimen,
        optimum=best,
        optima=optima,
        rings=tuple(rings),
        creeps=creeps,
        static=of_states,
        data_s=data_s,
        sources=sources,
        effects=effects,
        steps=steps,
        load_sigmas=load_sigmas or {},
        draws=drawn(best, steps, seed, omegas),
        draws_fit=drawn(best, steps, seed, omegas, of_sources=False),
        doubts=tuple(dict.fromkeys(doubts)),
        exposure_s=ringing[0][0].motion.exposure_s,
        wall_s=time.perf_counter() - began,
    )


def _doubts_of_section(table: RingTable) -> list[str]:
    """Return a warning if a three-dimensional model of the beam gives another modulus than the planar model."""
    try:
        change = table.solid_over_stated_modulus() - 1
    except NoEquilibrium:
        return []
    if abs(change) < _SECTION_CHANGE:
        return []
    section = table.beam.specimen.section
    return [
        f'the specimen is described with section = "{section}"; as a solid with these dimensions, the dynamic modulus '
        f'would be {abs(change):.1%} {"higher" if change > 0 else "lower"}: use section = "solid"'
    ]


def _same(one: object, other: object) -> bool:
    """Return whether two loads, or parts of them, are equal except for rounding."""
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if is_dataclass(one) and type(one) is type(other):
        return all(_same(getattr(one, part.name), getattr(other, part.name)) for part in fields(one))
    if isinstance(one, int | float | np.ndarray) and isinstance(other, int | float | np.ndarray):
        return bool(np.allclose(one, other))
    return one == other


def _analysed(
    motions: Sequence[RecordedMotion], specimen: Specimen
) -> tuple[list[tuple[RecordedMotion, Decay | None]], list[str]]:
    """Find the vibrations in each recorded motion, and collect the warnings."""
    analysed: list[tuple[RecordedMotion, Decay | None]] = []
    doubts = []
    for recorded in motions:
        motion, decay = recorded.motion, None
        try:
            signals = signals_of(motion, 0.0 if recorded.is_stepped else -np.inf)
            decay = decay_of(
                signals,
                motion.label or motion.kind.replace("_", "-"),
                specimen.length_mm,
                is_stepped=recorded.is_stepped,
                hangs=motion.hanging_N > 0,
            )
            decay = without_blur(decay, motion.exposure_s)
        except (NoVibration, TooFewFrames) as error:
            if motion.kind == "ring_down":
                doubts.append(str(error))
        if motion.lost_frames:
            lost = "1 frame was" if motion.lost_frames == 1 else f"{motion.lost_frames} frames were"
            doubts.append(f"{motion.label}: {lost} lost")
        analysed.append((recorded, decay))
    return analysed, doubts


def _table_for(recorded: RecordedMotion, decay: Decay, tables: list[RingTable], beam: RingingBeam) -> RingTable:
    """Find the table of computed frequencies for the loads of a recorded motion, or compute it."""
    for table in tables:
        if _same(table.beam.loads, recorded.loads) and table.beam.hanging_N == recorded.motion.hanging_N:
            return table
    middle = beam.modulus_at(decay.modes[0].frequency_Hz)
    table = RingTable(beam, middle)
    # The solid has a higher frequency than the planar model: the middle modulus is corrected for it.
    corrected = beam.modulus_at(decay.modes[0].frequency_Hz / float(table.solid_over_planar[0]))
    # The frequencies are stored for motions under equal loads.
    tables.append(RingTable(beam, corrected) if abs(np.log(corrected / middle)) > 0.3 else table)
    return tables[-1]


def _creeps(
    analysed: Sequence[tuple[RecordedMotion, Decay | None]],
    specimen: Specimen,
    law: Law,
    shape: Array,
    middle_Pa: float,
) -> tuple[CreepEvidence, ...]:
    """Return the slow rotations of the tip in the recorded motions that begin with a step of the load."""
    # ``shape``: the parameters of the law. ``middle_Pa``: a typical shear modulus.
    evidence = []
    for recorded, decay in analysed:
        if not recorded.is_stepped:
            continue
        motion, beam = recorded.motion, RingingBeam(specimen, recorded.loads, law, shape, recorded.motion.hanging_N)
        try:
            signals = signals_of(motion, 0.0)
        except TooFewFrames:
            continue
        before = recorded.before[-_MOST_STEPS:]
        bent_Pa = modulus_in_pictures(beam, middle_Pa, motion)
        per_rad = displacement_per_rad(beam, bent_Pa, recorded.loads, before[-1][1], motion.rest_mm)
        slow = slow_rotations(motion, signals, decay, per_rad)
        if slow is None:
            continue
        loads = Loads.joined([load for _, load in before] + [recorded.loads])
        history = LoadHistory.of(beam, middle_Pa, loads, [*(begin for begin, _ in before), 0.0])
        shown = shown_rotations(beam, bent_Pa, motion.rest_mm, signals, per_rad)
        evidence.append(CreepEvidence(history, *slow, label=motion.label, shown=shown))
    evidence.sort(key=lambda one: -float(np.ptp(one.rotation)))
    return tuple(evidence[:_MOST_CREEP_ROWS])


def _at_rest(
    ringing: Sequence[tuple[RecordedMotion, Decay]], table: RingTable, rings: Sequence[RingEvidence]
) -> tuple[RestEvidence | None, tuple[str, ...]]:
    """Estimate the shear modulus from the sag of the beam under its own weight, with warnings."""
    for (recorded, _), ring in zip(ringing, rings, strict=True):
        if ring.table is table and not recorded.is_stepped:
            # A ring-down under these loads, without a step, shows the sag.
            sag = Sag.of(table, recorded.motion, ring.decay)
            of_sag = sag.doubts(ring.decay, table.beam.specimen.length_mm) if sag else ()
            return RestEvidence.of(sag, table) if sag else None, of_sag
    return None, ()


def _static_evidence(static: StaticStates | None, specimen: Specimen, law: Law, shape: Array) -> StaticEvidence | None:
    if static is None:
        return None
    beams = [RingingBeam(specimen, run.loads.take(np.arange(1)), law, shape) for run in static.runs]
    runs = tuple(
        (LoadHistory.of(beam, static.modulus_Pa, run.loads, list(run.set_s)), run.seen_s)
        for beam, run in zip(beams, static.runs, strict=True)
    )
    loads = Loads.joined([run.loads for run in static.runs])
    return StaticEvidence(beams[0], runs, loads, static.modulus_Pa, static.sigma, dict(static.of_picture))


def _range_s(
    rings: Sequence[RingEvidence], creeps: Sequence[CreepEvidence], static: StaticEvidence | None
) -> tuple[float, float]:
    """Return the shortest and the longest time in s about which the data give information."""
    shortest = min(1 / (2 * np.pi * mode.frequency_Hz) for ring in rings for _, mode in ring.modes)
    longest = max(1 / (2 * np.pi * mode.frequency_Hz) for ring in rings for _, mode in ring.modes)
    for creep in creeps:
        longest = max(longest, float(creep.time_s[-1]))
    if static:
        longest = max(longest, static.age_s)
    return shortest / 3, 3 * longest


__all__ = [
    "SOURCES",
    "LawOfTime",
    "NoEquilibrium",
    "NoRingDown",
    "Prony",
    "RecordedMotion",
    "StaticRun",
    "StaticStates",
    "TimeOptimum",
    "identify_time",
]
