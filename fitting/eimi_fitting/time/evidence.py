"""Residuals of free vibrations and of the sag under the own weight, for the fit of a viscoelastic law.

A residual is a computed minus a measured quantity, divided by its standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.decay import Decay, RingMode
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import NoEquilibrium, RingingBeam

Array = NDArray[np.float64]

AT_REST_S = 1e4
"""A beam counts as being at rest if the last change of the load was at least this time ago, in s."""
MESH_ERROR = 3e-4  # relative error of a frequency after its correction to that of the solid
_LOSS_ERROR = 3e-3  # relative error of a loss
_HIGHER_ERROR = 0.015  # relative error of a higher frequency: clamp and magnet are not as stiff as they are modelled
_HIGHER_LOSS_ERROR = 0.05  # relative error of the loss of a higher mode
_SAME_MODE = 0.12  # relative difference within which a measured frequency belongs to a computed mode
_MODULI = 7
_LEAST_SAG = 0.02  # share of the length; a smaller sag is not used
_REST_SHAPE = 0.005  # share of the length by which a beam that is stated as straight at rest may be bent or turned
_BENT_BEAM = 0.1  # share of the length by which such a beam may be bent before its sag contradicts its vibration
_SOFTER_AT_REST = 4.0  # largest ratio of the modulus in a vibration to the modulus at rest
_STEP = 1.02  # ratio of two moduli whose difference gives the change of the sag with the modulus
_SAG_ERROR = 0.02  # relative error of the modulus at rest, from the mesh and the places of the points


class Evidence(Protocol):
    """Measurements to which a viscoelastic law is fitted, such as one recorded free vibration."""

    def residuals(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Return the residuals of the measurements for many candidate laws, one row each."""
        # ``instantaneous_Pa`` (P,): instantaneous shear moduli of P candidate laws. ``load_log`` (P,): logarithms of
        # factors on the magnetic loads. The result is (P, k) for k residuals.

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of each residual if an uncertain input, such as the width, changes by its uncertainty."""
        # ``sources``: the standard uncertainties of the inputs. The results are (components of the input, residuals).


@dataclass(frozen=True)
class RingEvidence:
    """Measured frequencies and loss factors of a free vibration, to which a viscoelastic law is fitted."""

    # Computed frequencies of the specimen.
    table: RingTable
    # The measured vibrations.
    decay: Decay
    # Index (0 for the lowest) and values of each measured mode.
    modes: tuple[tuple[int, RingMode], ...]
    # Factor on the standard uncertainties.
    inflation: float = 1.0
    # Number of ring-downs under these loads.
    repeats: int = 1
    # Time from the last change of the load to the vibrations, in which the beam creeps under constant loads.
    age_s: float = AT_REST_S

    @staticmethod
    def of(table: RingTable, decay: Decay, is_stepped: bool = False) -> RingEvidence:
        """Match measured vibrations to computed modes of the beam."""
        # ``is_stepped``: whether a change of the load starts the vibration.
        modes = [(0, decay.modes[0])]
        age_s = AT_REST_S
        loads = table.beam.loads
        if is_stepped and (loads.field_T.any() or loads.tip_force_N.any()):
            # While the beam creeps, its frequency changes. The fitted frequency is nearly that after this time.
            age_s = decay.from_s - 1 / decay.modes[0].rate.real
        if table.beam.hanging_N:
            return RingEvidence(table, decay, tuple(modes), age_s=age_s)
        computed = table.beam.undamped_Hz(table.middle_Pa) * table.solid_over_planar
        for mode in decay.modes[1:]:
            ratio = mode.frequency_Hz / decay.modes[0].frequency_Hz
            expected = computed[1:] / computed[0]
            k = int(np.argmin(np.abs(ratio / expected - 1)))
            # Higher modes have larger systematic errors: each measured one is matched to the nearest computed mode.
            if abs(ratio / expected[k] - 1) < _SAME_MODE and k + 1 not in [number for number, _ in modes]:
                modes.append((k + 1, mode))
        return RingEvidence(table, decay, tuple(modes), age_s=age_s)

    def residuals(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Return the residuals of all measured frequencies and loss factors for many candidate laws, one row each."""
        at_rest = instantaneous_Pa / series.creep(self.age_s)
        relative = (instantaneous_Pa / at_rest)[:, None]
        count = max(number for number, _ in self.modes) + 1
        roots = self.table.roots(np.log(at_rest), lambda s: relative * series.complex_ratio(s), count, load_log)
        rows = [
            self._whitened(
                number,
                mode,
                np.stack(
                    [
                        np.log(roots[:, number].imag / (2 * np.pi * mode.frequency_Hz)),
                        -2 * roots[:, number].real / roots[:, number].imag - mode.loss,
                    ],
                    axis=1,
                ),
            )
            for number, mode in self.modes
        ]
        return np.concatenate(rows, axis=1)

    def _whitened(self, number: int, mode: RingMode, gaps: Array) -> Array:
        """Divide errors of ln(frequency) and loss factor by their uncertainties, and remove their correlation."""
        # ``number``: index of the mode, 0 for the lowest. ``gaps`` (..., 2): the errors.
        errors = (_HIGHER_ERROR, _HIGHER_LOSS_ERROR) if number else (self._lowest_frequency_error, _LOSS_ERROR)
        # An error of the table is common to all ring-downs under equal loads, and does not average out: each ring-down
        # gets a share of the weight of one.
        of_table = self.repeats * np.square([errors[0], errors[1] * mode.loss])
        covariance = self.inflation**2 * mode.covariance + np.diag(of_table)
        return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), gaps[..., None])[..., 0])

    @property
    def _lowest_frequency_error(self) -> float:
        # Relative, due to the mesh and to the thread of a weight that hangs at the tip.
        return float(np.hypot(MESH_ERROR, 0.5 * self.table.fixed_weight_log))

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of each residual if an uncertain input, such as the width, changes by its uncertainty."""
        return {
            key: np.concatenate(
                [
                    self._whitened(number, mode, np.stack([change[:, number], np.zeros(len(change))], axis=1))
                    for number, mode in self.modes
                ],
                axis=1,
            )
            for key, change in self.table.effects(sources).items()
        }


@dataclass(frozen=True)
class Sag:
    """The measured and the computed sag of a beam under its own weight."""

    # Largest sag of a point in mm, computed with the modulus that the frequency suggests.
    computed_mm: float
    # The measured sag, divided by this computed sag.
    measured: float
    # (m,): shear moduli.
    moduli_Pa: Array
    # (m,): the sag with each modulus in ``moduli_Pa``, divided by the sag with the modulus that the frequency
    # suggests.
    ratios: Array
    # (p, 2): positions (x, y) at rest of the points whose sag was measured.
    rest_mm: Array

    @staticmethod
    def of(table: RingTable, motion: Motion, decay: Decay) -> Sag | None:
        """Return the measured sag of a beam under its own weight, and the computed sag for several moduli.

        None if too few points are visible, or if the computed beam does not bend.
        """
        late = (motion.time_s >= decay.from_s) & motion.seen
        count = late.sum(axis=0)
        points = count > 0.3 * late.shape[0]
        if not points.any():
            return None
        places = np.where(late[..., None], motion.points_mm, 0.0).sum(axis=0)[points] / count[points, None]
        rest = motion.rest_mm[points]
        moved = (places - rest)[:, 1]
        moduli = table.middle_Pa * np.geomspace(0.3, 3.0, 2 * _MODULI)
        sag, sound = _computed_sag(table.beam, moduli, rest)
        sag = sag[sound]
        if not len(sag):
            return None
        # The computed sag is that with about the modulus of the measured frequency.
        middle = sag[np.argmin(np.abs(moduli[sound] - table.middle_Pa))]
        size = float(middle @ middle)
        if not size:
            return None
        return Sag(float(np.abs(middle).max()), float(moved @ middle / size), moduli[sound], sag @ middle / size, rest)

    def doubts(self, decay: Decay, length_mm: float) -> tuple[str, ...]:
        """Return a warning if the sag and the frequency of a beam contradict each other."""
        bent = _BENT_BEAM * length_mm / self.computed_mm
        if 1 - bent < self.measured < _SOFTER_AT_REST + bent:
            return ()
        return (
            f"{decay.label}: at rest the beam sags by {self.measured * self.computed_mm:.2g} mm, but a beam that "
            f"vibrates at {decay.modes[0].frequency_Hz:.3g} Hz would sag by {self.computed_mm:.2g} mm or a little "
            "more: check the frame rate (is it slow motion?), the dimensions, the direction of gravity, and whether "
            "the beam is straight without a load",
        )


def _computed_sag(beam: RingingBeam, moduli_Pa: Array, rest_mm: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the computed sag of points of a beam in mm, and whether the beam has an equilibrium."""
    # For m shear moduli and p points with the positions ``rest_mm`` (p, 2) at rest: (m, p) and (m,).
    model = beam.planar()
    rest = model.grid.strip.nearest(rest_mm)
    shapes = model.solve(beam.law, beam.parameters(moduli_Pa), beam.loads)
    return (model.positions(shapes, rest)[:, 0] - rest)[..., 1], shapes.status[:, 0] == 0


@dataclass(frozen=True)
class RestEvidence:
    """The shear modulus of a beam at rest, from its sag under its own weight."""

    # The shear modulus.
    modulus_Pa: float
    # Its relative standard uncertainty.
    sigma: float
    # The beam, and the positions at rest (x, y) of the points whose sag was measured, (p, 2).
    table: RingTable
    rest_mm: Array

    @staticmethod
    def of(sag: Sag, table: RingTable) -> RestEvidence | None:
        """Find the shear modulus for which the computed sag of the beam equals the measured sag."""
        # A small sag, or one outside the computed range, gives no modulus.
        if sag.computed_mm < _LEAST_SAG * table.beam.specimen.length_mm:
            return None
        along = sag.ratios
        order = np.argsort(along)
        if not along[order[0]] < sag.measured < along[order[-1]]:
            return None
        logs = np.log(sag.moduli_Pa)[order]
        log_modulus = np.interp(sag.measured, along[order], logs)
        slope = np.abs(np.gradient(logs, along[order]))
        at = float(np.interp(sag.measured, along[order], slope))
        straight = _REST_SHAPE * table.beam.specimen.length_mm / sag.computed_mm
        # The sag is computed with the planar model.
        modulus = float(np.exp(log_modulus)) / table.planar_over_solid_modulus
        return RestEvidence(modulus, float(np.hypot(_SAG_ERROR, at * straight)), table, sag.rest_mm)

    def residuals(self, instantaneous_Pa: Array, series: Prony, load_log: Array) -> Array:
        """Return the residual between the shear modulus after 10⁴ s and the modulus from the sag, for many laws."""
        # (P, 1) for P laws. ``load_log`` has no influence.
        at_rest = instantaneous_Pa * series.ratio(np.array([AT_REST_S]))[:, 0]
        return np.asarray(np.log(at_rest / self.modulus_Pa)[:, None] / self.sigma)

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of the residual if an uncertain input, such as the width, changes by its uncertainty."""
        # ``sources``: the standard uncertainties of the inputs. The results are (components of the input, 1).
        # The sag is measured from the stated shape at rest, so that an input that changes only this shape or the image
        # changes the measured sag, too.
        beam = self.table.beam
        stiffer, before, softer = self._places(beam, np.array([_STEP, 1.0, 1 / _STEP]))
        slope = (stiffer - softer)[:, 1] / (2 * np.log(_STEP))
        # A point of a film is found by its distance from the clamp along the beam in the image. If the image is shifted
        # along the beam, the measurement belongs to another point of the beam.
        step_mm = np.array([1e-3 * beam.specimen.length_mm, 0.0])
        along = before - replace(self, rest_mm=self.rest_mm - step_mm)._places(beam, np.ones(1))[0]
        rise = along[:, 1] / step_mm[0]
        effects = {}
        for key, sigma in sources.items():
            parts = len(SOURCES[key].parts)
            change = np.zeros((parts, 1))
            for part, changed in enumerate(beam.changed_by(key, sigma) or (beam,) * parts):
                true = self._places(changed, np.ones(1))[0]
                image = Setup.of([(key, part, sigma)], 1)
                shift_mm = (image.imaged(true) - true)[:, 1]
                along_mm = (image.imaged(self.rest_mm) - self.rest_mm)[:, 0]
                moved = (true - before)[:, 1] + shift_mm - rise * along_mm
                change[part] = (moved @ slope) / (slope @ slope)
            effects[key] = change / self.sigma
        return effects

    def _places(self, beam: RingingBeam, factors: Array) -> Array:
        """Return the computed places (x, y) of the measured points in mm, for each factor on the shear modulus."""
        planar_Pa = self.modulus_Pa * self.table.planar_over_solid_modulus
        model, stated = beam.planar(), self.table.beam.planar().grid.strip
        strip = model.grid.strip
        rest = strip.nearest(strip.at_rest(stated.straightened(stated.nearest(self.rest_mm))))
        shapes = model.solve(beam.law, beam.parameters(planar_Pa * factors), beam.loads)
        if shapes.status[:, 0].any():
            raise NoEquilibrium(f"the specimen has no stable equilibrium at a shear modulus of {planar_Pa:.3g} Pa")
        return model.positions(shapes, rest)[:, 0]


def with_scatter(rings: Sequence[RingEvidence]) -> tuple[RingEvidence, ...]:
    """Increase the uncertainties of repeated free vibrations if they scatter more than expected."""
    widened = []
    for ring in rings:
        alike = [other for other in rings if other.table is ring.table]
        if len(alike) < 2:
            widened.append(ring)
            continue
        values = np.array([[np.log(r.modes[0][1].frequency_Hz), r.modes[0][1].loss] for r in alike])
        spread = np.array(
            [np.sqrt(np.diag(r.modes[0][1].covariance) + np.square([MESH_ERROR, _LOSS_ERROR * r.modes[0][1].loss]))
             for r in alike]
        )  # fmt: skip
        mean = (values / spread**2).sum(axis=0) / (1 / spread**2).sum(axis=0)
        # Birge ratio: the root of chi-square / degrees of freedom.
        ratio = np.sqrt((((values - mean) / spread) ** 2).sum(axis=0) / (len(alike) - 1)).max()
        widened.append(replace(ring, inflation=float(max(ratio, 1.0)), repeats=len(alike)))
    return tuple(widened)
