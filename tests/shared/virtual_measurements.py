"""Simulate measurements with random errors of all uncertain inputs, and count the intervals that contain the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.depth_effect import DepthEffect
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup, Unknowns
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_lab.config.rig import load_rig
from eimi_lab.config.rig_uncertainty import stated_by_rig
from eimi_lab.config.specimen import load_specimen

Array = NDArray[np.float64]
FIELD_MT = np.array([0.75, 1.75, 3.0, 4.5])
CORRELATED_OVER_MM = 1.0
NOISE_MM = (0.001, 0.005, 0.05)
# A material of about 46 kPa for each law: modulus in Pa and ratios, away from the bounds of the search.
COORDINATES = {
    "neo-hookean": (46e3,),
    "mooney-rivlin": (46e3, 0.2),
    "yeoh": (46e3, 0.35, -0.15),
    "ogden": (46e3, 0.6, 0.5, 2.0, 5.0, -2.0),
}
SPECIMENS = ("type1", "type2", "type3", "type4")
ALONG, ACROSS = 26, 3  # elements of the true beam
BEGUN_WITHIN = 0.2  # largest distance of the start from the true modulus, as a logarithm
LARGEST_RATIO, LOWEST, HIGHEST = 1.15, 93.0, 97.0
NORMAL = 1.96


@dataclass(frozen=True)
class Case:
    """One simulated experiment; its number, from 0, selects law, noise, specimen and beam model.

    is_usual : whether the inputs have their usual uncertainties, and not those of the example bench
    """

    number: int
    seed: int
    is_usual: bool = False

    @property
    def model(self) -> str:
        """The name of the law, a key of LAWS."""
        return "neo-hookean" if self.is_usual else list(COORDINATES)[self.number % 4]

    @property
    def stated(self) -> tuple[StatedSource, ...]:
        """The standard uncertainties that the files of the experiment give."""
        return usual() if self.is_usual else stated()

    @property
    def noise_mm(self) -> float:
        """Standard deviation (mm) of each part of the noise, white and correlated."""
        return NOISE_MM[self.number // 4 % 3]

    @property
    def is_solid(self) -> bool:
        """Whether the beam is simulated as a solid."""
        return not self.is_usual and self.number // 12 % 4 == 3

    @property
    def specimen(self) -> Specimen:
        """The nominal specimen of the experiment."""
        name = SPECIMENS[self.number // 48 % 4]
        return replace(load_specimen(name).mechanics(), section="solid" if self.is_solid else "plane-stress")


@dataclass(frozen=True)
class Outcome:
    # The result of one simulated fit. The modulus and the ends of its intervals are divided by the true modulus.
    # interval : the 95 % interval
    # fit_alone : the 95 % interval from noise and mesh alone
    # drawn : shift of the modulus by the random errors of the inputs, divided by the standard deviation of such shifts
    # seconds : processor time

    case: Case
    value: float
    interval: tuple[float, float]
    fit_alone: tuple[float, float]
    drawn: float
    seconds: float


@cache
def stated() -> tuple[StatedSource, ...]:
    """Return the uncertainties of the example bench that apply to a telecentric camera."""
    rig = load_rig("bench_example")
    every = (
        *load_specimen("bench_example").stated_sources(),
        *rig.calibration.stated_sources(),
        *stated_by_rig(rig.text, "bench_example", rig.calibration.coil_constant_mT_per_A),
    )
    return tuple(s for s in every if SOURCES[s.source].lens is None)


@cache
def usual() -> tuple[StatedSource, ...]:
    # Return the usual standard uncertainties of all inputs of a measurement with a telecentric camera.
    return tuple(
        StatedSource(name, source.usual, source.stated_in)
        for name, source in SOURCES.items()
        if source.stated_in and source.lens is None
    )


@cache
def true_parameters(model: str) -> Array:
    """Return the true parameters of the law `model`, moduli in Pa, shape (1, n) for n parameters."""
    space = search_space(LAWS[model])
    lower, upper, true = np.array(space.lower), np.array(space.upper), np.array(COORDINATES[model])
    unit = (true - lower) / (upper - lower)
    unit[0] = np.log(true[0] / lower[0]) / np.log(upper[0] / lower[0])
    return space.parameters(unit[None])


def begun_at(model: str, rng: np.random.Generator) -> Array:
    """Return a random start of the fit near the truth, scaled to 0 to 1, shape (n,) for n parameters."""
    space = search_space(LAWS[model])
    modulus = COORDINATES[model][0] * np.exp(rng.uniform(-BEGUN_WITHIN, BEGUN_WITHIN))
    unit = rng.uniform(0.25, 0.75, len(space.names))
    unit[0] = np.log(modulus / space.lower[0]) / np.log(space.upper[0] / space.lower[0])
    return unit


@cache
def effect_of_depth(model: str, specimen: Specimen) -> DepthEffect | None:
    # Return the differences between the shapes of the solid and of the planar model of a bent beam. The result is None
    # for a specimen that is simulated by the planar model.
    if specimen.section != "solid":
        return None
    turns = Loads.along(np.linspace(0.0, 1.1 * FIELD_MT[-1], 8))
    return SolidBeside(specimen, ALONG, ACROSS).solve(LAWS[model], true_parameters(model), turns).effect


def deviations_drawn(rng: np.random.Generator, sources: Sequence[StatedSource]) -> dict[str, Array]:
    # Return random errors of the uncertain inputs by name; an array has one error for each component, such as x and y.
    return {s.source: s.standard_uncertainty * rng.normal(size=len(SOURCES[s.source].parts)) for s in sources}


def measured(case: Case, deviations: Mapping[str, Array], rng: np.random.Generator) -> Experiment:
    """Return a simulated experiment: edges that are computed with the true inputs, and the nominal inputs.

    deviations : true minus nominal values, by name of the uncertain input
    """
    setup = Setup.of(((s, part, value) for s, values in deviations.items() for part, value in enumerate(values)), 1)
    loads = Loads.along(FIELD_MT)
    beam = specimen_under(case.specimen, deviations)
    effect = effect_of_depth(case.model, case.specimen)
    model: BeamModel | SolidBeside
    more: dict[str, Any] = {}
    if effect is None:
        model = BeamModel(beam, ALONG, ACROSS, beam.planar_section)
    else:
        model, more = SolidBeside(beam, ALONG, ACROSS), {"options": SolidOptions(effect=effect)}
    shapes = model.solve(
        LAWS[case.model],
        true_parameters(case.model),
        loads_under(loads, deviations),
        tolerance_mm=1e-3,
        field_factor=setup.field_factor,
        **more,
    )
    if not shapes.converged[0]:
        raise RuntimeError(f"{case}: the true beam has no equilibrium")
    edges = setup.imaged(points_on(outline(model, shapes)[0], 4)[:, :, 4:-4])
    flat = BeamModel(case.specimen, plane=case.specimen.planar_section)
    return Experiment(flat, loads, with_noise(edges, case.noise_mm, rng), stated=case.stated)


def with_noise(edges: Array, noise_mm: float, rng: np.random.Generator) -> EdgeObservation:
    """Return edges with white and correlated noise normal to the edge.

    edges : points (x, y) in mm, shape (K, 2, m, 2): K load steps, two edges, m points
    noise_mm : standard deviation of each noise
    """
    along = np.gradient(edges, axis=2)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    length = np.cumsum(np.linalg.norm(np.diff(edges[0, 0], axis=0, prepend=edges[0, 0, :1]), axis=1))
    covariance = np.exp(-np.abs(length[:, None] - length) / CORRELATED_OVER_MM)
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(length)))
    white, together = rng.normal(size=(2, *edges.shape[:3]))
    points = edges + (noise_mm * (white + together @ root.T))[..., None] * across
    sigma = np.full(edges.shape[2], np.sqrt(2) * noise_mm)
    return EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in points])


def outcome(case: Case) -> Outcome:
    """Simulate one experiment, fit it, and return the result."""
    start_s = time.process_time()
    rng = np.random.default_rng([case.seed, case.number])
    deviations, law = deviations_drawn(rng, case.stated), LAWS[case.model]
    experiment = measured(case, deviations, rng)
    problem = Problem(law, Unknowns(search_space(law)), (experiment,))
    estimate = refine(problem, begun_at(case.model, rng), case.number).estimate
    modulus = estimate.initial_shear_modulus
    truth = COORDINATES[case.model][0]
    low, high = modulus.interval_95
    alone_low, alone_high = modulus.interval_95_fit or modulus.interval_95
    return Outcome(
        case=case,
        value=modulus.value / truth,
        interval=(low / truth, high / truth),
        fit_alone=(alone_low / truth, alone_high / truth),
        drawn=drawn(case, estimate, deviations),
        seconds=time.process_time() - start_s,
    )


def drawn(case: Case, estimate: Estimate, deviations: Mapping[str, Array]) -> float:
    # Return the shift of the modulus by the drawn errors of the inputs, divided by its standard deviation.
    law = LAWS[case.model]
    parameters = np.column_stack([estimate.draws.column(name) for name in law.parameter_names])
    numbers = [(key, part) for key, values in deviations.items() for part in range(len(values))]
    deviations_of_draws = np.column_stack([estimate.draws.column(SOURCES[key].parts[part]) for key, part in numbers])
    columns = np.column_stack([np.ones(len(deviations_of_draws)), deviations_of_draws])
    slopes = np.linalg.lstsq(columns, np.log(law.initial_shear_modulus(parameters)), rcond=None)[0][1:]
    sizes = {s.source: s.standard_uncertainty for s in case.stated}
    spread = np.linalg.norm([slope * sizes[key] for slope, (key, _) in zip(slopes, numbers, strict=True)])
    off = sum(slope * deviations[key][part] for slope, (key, part) in zip(slopes, numbers, strict=True))
    return float(off / spread)


@dataclass(frozen=True, kw_only=True)
class Row:
    # Statistics of a group of simulated fits.
    # held_percent : share of the intervals that contain the truth
    # chance_percent : 95 % confidence interval of this share
    # drawn_percent : share of the simulated fits in which the input errors shift the modulus by less than 1.96 times
    #     the standard deviation of this shift
    # over_needed : half-width of the intervals, divided by the one that would contain the truth in 95 % of the fits
    # over_needed_least : lower bound of `over_needed`, with a confidence of 97.5 %

    name: str
    experiments: int
    half_width_percent: float
    fit_alone_half_width_percent: float
    held_percent: float
    chance_percent: tuple[float, float]
    drawn_percent: float
    fit_alone_percent: float
    over_needed: float
    over_needed_least: float

    @property
    def is_right(self) -> bool:
        """Whether the fits agree with a coverage of 93 to 97 % and with intervals that are at most 15 % too wide."""
        low, high = self.chance_percent
        return low <= HIGHEST and high >= LOWEST and self.over_needed_least <= LARGEST_RATIO


def row(name: str, outcomes: Sequence[Outcome]) -> Row:
    """Return the statistics of a group of fits."""
    logs = np.log([[o.value, *o.interval, *o.fit_alone] for o in outcomes])
    value, low, high, fit_low, fit_high = logs.T
    contains_truth = (low <= 0) & (high >= 0)
    chance = stats.binomtest(int(contains_truth.sum()), len(contains_truth)).proportion_ci(
        0.95, "exact"
    )  # Clopper and Pearson 1934
    shares = np.sort(np.abs(value) / np.where(value > 0, value - low, high - value))
    # The order statistics that enclose the 95 % quantile with a confidence of 95 %.
    upper = min(int(stats.binom.ppf(0.975, len(shares), 0.95)), len(shares) - 1)
    return Row(
        name=name,
        experiments=len(outcomes),
        half_width_percent=float(50 * np.mean(high - low)),
        fit_alone_half_width_percent=float(50 * np.mean(fit_high - fit_low)),
        held_percent=float(100 * np.mean(contains_truth)),
        chance_percent=(100 * chance.low, 100 * chance.high),
        drawn_percent=float(100 * np.mean([abs(o.drawn) < NORMAL for o in outcomes])),
        fit_alone_percent=float(100 * np.mean((fit_low <= 0) & (fit_high >= 0))),
        over_needed=float(1 / np.quantile(shares, 0.95)),
        over_needed_least=float(1 / shares[upper]),
    )
