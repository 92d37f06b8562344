"""Residuals of creep and of static shapes, for the fit of a viscoelastic law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.evidence.sources import SOURCES, loads_under
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.loaded_creep import CreepHistories, LoadCurve, LoadStep
from eimi_fitting.time.ringing_beam import RingingBeam

Array = NDArray[np.float64]

_MODULI = 7
_STRONGER = 1.05  # factor on the field, which tells the moments of the field from those of gravity
_CREEP_ERROR = 0.02  # share of the range of a creep curve: error of the proportional curvature (`time.loaded_creep`)
_RECOVERY_ERROR = 0.06  # the same without a load, when the curvature changes its distribution most
_OF_SQUARE = 0.2  # rad/rad²: standard deviation of a bent beam's mean rotation, divided by its squared amplitude
_STATIC_ERROR = 2e-3  # relative error of the modulus of static states due to the proportional curvature


@dataclass(frozen=True)
class LoadHistory:
    """The loads on a beam in the order of time."""

    steps: tuple[LoadStep, ...]

    @staticmethod
    def of(beam: RingingBeam, modulus_Pa: float, loads: Loads, begins_s: Sequence[float]) -> LoadHistory:
        """Compute, for each load, when it begins, and its moment as a function of the rotation of the tip."""
        # ``modulus_Pa``: a shear modulus near the true one. ``begins_s``: the time at which each load begins.
        # The moment of the loads is interpolated between static equilibria with seven moduli, in which it equals the
        # modulus times the rotation.
        model, moduli = beam.planar(), modulus_Pa * np.geomspace(0.4, 2.5, _MODULI)
        # In a stronger field, a beam that is stiffer by the same factor turns by nearly the same rotation.
        factors = np.repeat([1.0, _STRONGER], _MODULI if loads.field_T.any() else [_MODULI, 0])
        moduli = factors * np.resize(moduli, len(factors))
        shapes = model.solve(beam.law, beam.parameters(moduli), loads, field_factor=factors)
        rotation = np.radians(model.tip_angle_deg(shapes))
        largest = np.abs(rotation).max()
        gravity = _stiffness_of_gravity(beam, modulus_Pa)
        curves = []
        for k in range(len(loads)):
            theta, sound = rotation[:, k], shapes.status[:, k] == 0
            nominal, stronger = (np.flatnonzero(sound & (factors == one)) for one in (1.0, _STRONGER))
            if len(nominal) < 2 or np.ptp(theta[nominal]) < 1e-3 * max(largest, 1e-6):
                curves.append(LoadCurve.of_gravity(gravity))
                continue
            moment = moduli * theta
            has_field = bool(loads.field_T[k].any())
            pairs = [(theta[rows], moment[rows]) for rows in (nominal, stronger if has_field else nominal)]
            curves.append(LoadCurve.through(pairs[0], pairs[1], _STRONGER))
        return LoadHistory(tuple(LoadStep(float(t), curve) for t, curve in zip(begins_s, curves, strict=True)))


def _stiffness_of_gravity(beam: RingingBeam, modulus_Pa: float) -> float:
    """Return the stiffness of a beam that is due to gravity, as an equivalent shear modulus in Pa."""
    # ``modulus_Pa``: a shear modulus near the true one.
    loads = replace(beam.loads, field_T=np.zeros_like(beam.loads.field_T))
    motion, _ = beam.vibration(beam.planar()).about(beam.law, beam.parameters(np.array([modulus_Pa])), loads)
    return float(modulus_Pa * motion.rest[0, 0, 0] / motion.material[0, 0, 0])


@dataclass(frozen=True)
class CreepEvidence:
    """The measured slow rotation of the tip after a step of the load, to which a viscoelastic law is fitted."""

    # The loads over time.
    history: LoadHistory
    # `time_s`, `rotation`, `sigma` (k,): times after the step, rotations in rad, and their standard uncertainties.
    time_s: Array
    rotation: Array
    sigma: Array
    # (k,): squared amplitude of the free vibration that the step also causes, in rad². The vibration shifts the mean
    # rotation of a bent beam in proportion to this square.
    squares: Array
    # The name of the recording.
    label: str
    # Increasing rotations of the tip, and the rotations that would be measured instead, in rad. They differ if the beam
    # is strongly bent. None: they are equal.
    shown: tuple[Array, Array] | None = None

    def shown_at(self, true: Array) -> Array:
        """Convert true to measured tip rotations; the measurement is wrong for a strongly bent beam."""
        # The measurement divides the displacements by a constant, but the displacements of a strongly bent beam are not
        # proportional to the rotation.
        if self.shown is None:
            return true
        nodes, values = self.shown
        first = np.clip(np.searchsorted(nodes, true) - 1, 0, len(nodes) - 2)
        slopes = np.diff(values) / np.diff(nodes)
        return np.asarray(values[first] + slopes[first] * (true - nodes[first]))

    def predicted(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Compute the rotation of the tip that would be measured over time for many candidate laws, one row each."""
        # ``load_log`` (P,): logarithms of the factors on the magnetic loads. The result is (P, k) in rad.
        history = CreepHistories([(self.history.steps, self.time_s)])
        return self.shown_at(history.rotations(instantaneous_Pa, series, np.exp(load_log))[0])

    def residuals_at(self, rotations: Array) -> Array:
        """Return the residuals for the tip rotations that many candidate laws predict, one row each."""
        # ``rotations`` (P, k): the true rotations at k times for each law, in rad. The result is (P, k + 1): the last
        # residual is that of an unknown with a prior, the shift of the mean rotation by the free vibration.
        gap = self.shown_at(rotations) - self.rotation
        error = _RECOVERY_ERROR if self.shown is None else _CREEP_ERROR
        # The error changes slowly: all times within a decade have the same error.
        decades = max(1.0, float(np.log10(self.time_s[-1] / self.time_s[0])))
        error *= np.sqrt(max(1.0, len(self.time_s) / decades))
        sigma = np.hypot(self.sigma, error * np.ptp(self.rotation))
        of_square = 0.0 if self.shown is None else _OF_SQUARE
        # Two unknown parts of the measured rotation are eliminated: a constant, and the shift of the mean rotation by
        # the free vibration.
        unknown = np.zeros((len(sigma) + 1, 2))
        unknown[:-1] = np.stack([1 / sigma, of_square * self.squares / sigma], axis=1)
        unknown[-1, 1] = 1.0
        basis, _ = np.linalg.qr(unknown)
        rows = np.append(gap / sigma, np.zeros((len(gap), 1)), axis=1)
        return np.asarray(rows - rows @ basis @ basis.T)

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return zeros: the influence of uncertain inputs on creep is neglected."""
        return {key: np.zeros((len(SOURCES[key].parts), len(self.time_s) + 1)) for key in sources}


@dataclass(frozen=True)
class StaticEvidence:
    """The shear modulus of an elastic fit to static shapes, as a measurement for a viscoelastic law."""

    # The specimen.
    beam: RingingBeam
    # For each run, the loads over time, and the times at which edges were measured.
    runs: tuple[tuple[LoadHistory, Array], ...]
    # The loads of all states.
    loads: Loads
    # Initial shear modulus of the elastic fit.
    modulus_Pa: float
    # Relative standard uncertainty of the modulus due to noise and mesh.
    sigma: float
    # Relative change of the modulus by errors of the picture, such as the scale.
    stated: dict[str, float] = field(default_factory=dict)

    @property
    def age_s(self) -> float:
        """The median time in s from the setting of a load to the measurement of the edges."""
        ages = [seen_s - np.array([step.time_s for step in history.steps]) for history, seen_s in self.runs]
        return float(np.median(np.concatenate(ages)))

    @cached_property
    def orders(self) -> tuple[NDArray[np.intp], ...]:
        """For each run, the indices of its shapes in the order in which they were measured."""
        return tuple(np.argsort(seen_s) for _, seen_s in self.runs)

    @property
    def histories(self) -> list[tuple[tuple[LoadStep, ...], Array]]:
        """For each run, its loads over time, and the increasing times at which edges were measured."""
        return [(run.steps, seen_s[order]) for (run, seen_s), order in zip(self.runs, self.orders, strict=True)]

    def apparent_log(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Return ln(modulus) from an elastic fit to the loaded shapes of a viscoelastic beam, for many laws."""
        # ``load_log`` (P,): logarithms of the factors on the magnetic loads. The result is (P,).
        rotations = CreepHistories(self.histories).rotations(instantaneous_Pa, series, np.exp(load_log))
        return self._apparent_log(rotations)

    def _apparent_log(self, rotations: Sequence[Array]) -> Array:
        """Return ln(modulus) of the elastic beam whose tip rotates like that of a viscoelastic beam."""
        # ``rotations``: for each run, the rotations of the tip for P laws, (P, shapes) in rad. The result is (P,).
        # The modulus of an elastic beam is the moment of the loads (in Pa rad) divided by the rotation. The result is a
        # mean over the states.
        total, weights = np.zeros(len(rotations[0])), np.zeros(len(rotations[0]))
        for (run, _), order, theta in zip(self.runs, self.orders, rotations, strict=True):
            for column, k in enumerate(order):
                curve = run.steps[k].curve
                if len(curve.rotation) < 3:
                    continue
                at = theta[:, column]
                moment, _ = curve.at(at)
                weight = at**2
                total += weight * np.log(np.maximum(moment / np.where(at == 0, 1.0, at), 1e-6))
                weights += weight
        return total / np.maximum(weights, 1e-30)

    def residuals_at(self, rotations: Sequence[Array]) -> Array:
        """Return the residual between the elastic modulus that follows from tip rotations and the fitted one."""
        # It compares the modulus that a fit without time dependence would find, if the tip had the computed rotations,
        # with the modulus of the real fit. ``rotations``: the rotations of the tip that P laws predict for each run,
        # (P, shapes) in rad. The result is (P, 1).
        gap = self._apparent_log(rotations) - np.log(self.modulus_Pa)
        return np.asarray(gap[:, None] / np.hypot(self.sigma, _STATIC_ERROR))

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of the residual if an uncertain input, such as the width, changes by its uncertainty."""
        # ``sources``: the standard uncertainties of the inputs. The results are (components of the input, 1).
        scale = np.hypot(self.sigma, _STATIC_ERROR)
        before = self._rotations(self.beam, 1.0)
        slope = (self._rotations(self.beam, 1.02) - self._rotations(self.beam, 1 / 1.02)) / (2 * np.log(1.02))
        effects = {}
        for key, sigma in sources.items():
            source = SOURCES[key]
            change = np.zeros((len(source.parts), 1))
            if source.field and not (source.specimen or source.loads):
                moved = self._rotations(self.beam, 1.0, 1 + sigma) - before
                change[0] = (moved @ slope) / (slope @ slope)
            elif source.specimen or source.loads:
                for part in range(len(source.parts)):
                    deviation = np.zeros(len(source.parts))
                    deviation[part] = sigma
                    under = self.beam.under({key: deviation})
                    moved = self._rotations(under, 1.0, 1.0, {key: deviation}) - before
                    change[part] = (moved @ slope) / (slope @ slope)
            else:
                change[0] = self.stated.get(key, 0.0)
            effects[key] = change / scale
        return effects

    def _rotations(
        self,
        beam: RingingBeam,
        factor: float,
        field_factor: float = 1.0,
        deviations: Mapping[str, Array] | None = None,
    ) -> Array:
        model = beam.planar()
        loads = loads_under(self.loads, deviations) if deviations else self.loads
        parameters = beam.parameters(np.array([factor * self.modulus_Pa]))
        shapes = model.solve(beam.law, parameters, loads, field_factor=np.array([field_factor]))
        return np.asarray(np.radians(model.tip_angle_deg(shapes))[0])


class SlowEvidence:
    """All recordings of creep and the static shapes, to which a viscoelastic law is fitted."""

    def __init__(self, creeps: Sequence[CreepEvidence], static: StaticEvidence | None) -> None:
        self._creeps, self._static = tuple(creeps), static
        # All recordings together take hardly longer than one recording.
        self._histories = CreepHistories(
            [*((creep.history.steps, creep.time_s) for creep in creeps), *(static.histories if static else [])]
        )

    def residuals(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Return the residuals of creep and of static shapes for many candidate laws, one row each."""
        rotations = self._histories.rotations(instantaneous_Pa, series, np.exp(load_log))
        rows = [creep.residuals_at(true) for creep, true in zip(self._creeps, rotations, strict=False)]
        if self._static:
            rows.append(self._static.residuals_at(rotations[len(self._creeps) :]))
        return np.concatenate(rows, axis=1)

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of each residual if an uncertain input, such as the width, changes by its uncertainty."""
        parts = [creep.effects(sources) for creep in self._creeps]
        if self._static:
            parts.append(self._static.effects(sources))
        return {key: np.concatenate([part[key] for part in parts], axis=1) for key in sources}
