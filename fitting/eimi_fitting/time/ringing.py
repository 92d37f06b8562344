"""Frequencies and loss factors of the free vibrations of a beam, as functions of its viscoelastic law."""

# In a vibration exp(s t), the modulus is the shear modulus at rest times a complex ratio r(s). The rate s of a mode is
# the solution of
#
#     s² = -lambda(r(s)),
#
# where lambda(r) is the squared angular frequency of the undamped mode for the ratio r. It is computed for a few moduli
# and a few real ratios, and interpolated: between the moduli, and by r times a polynomial in 1/r, which also holds for
# complex r. The modes are those of a planar model. Factors correct them to a more accurate model, which is
# three-dimensional if the specimen file has ``section = "solid"``.

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebval, chebvander
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.modal_motion import ReducedMotion, fixed_point, squares_by_stiffening
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import candidates
from eimi_fitting.beam.specimen import STANDARD_GRAVITY
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.time.ringing_beam import NoEquilibrium, RingingBeam

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Ratio = Callable[[ComplexArray], ComplexArray]

_MODULI = 5
_SOLID_MM = 1e-4
_LEAST_TURN_DEG = 1e-3
_SPAN = np.log(2.0)  # natural logarithm: the moduli reach from half of the middle one to twice the middle one
_SHAPES = 4  # modes at each modulus and each stiffening
_STIFFENINGS = (1.0, 2.0)  # at 7 mT one of them alone gives losses that are 2 % too high
_LEAST_RATIO = 0.6  # of r; polynomials in 1 / r also hold for every larger ratio
_DEGREE = 10  # of the polynomials in 1 / r
_MODES = 3
_RATIOS = (0.9, 1.2)  # of the modulus in a vibration to the equilibrium modulus, as silicones have them
_CORRECTIONS, _STEP = 6, 1e-4  # Newton steps for the factors on the ratios r, and step of their finite differences
_NO_SLOPE, _LARGEST = 1e-3, 0.25  # a smaller slope changes no factor; largest logarithm of a factor
_LOAD_LOGS = np.array([-0.2, 0.0, 0.2])  # logarithms of the factors on the magnetic loads at which modes are computed
_SOLID = (20, 2)  # elements along and across
_FINE_ACROSS = 8  # elements across the planar model that corrects the solid model for its coarse mesh


class RingTable:
    """A table of the frequencies and decay rates of a beam's free vibrations, for a range of shear moduli.

    Raises
    ------
    NoEquilibrium
        The beam has no stable equilibrium even with one of the larger shear moduli.
    """

    def __init__(self, beam: RingingBeam, middle_Pa: float) -> None:
        # ``middle_Pa``: geometric mean of the shear moduli at rest.
        self.beam, self.middle_Pa = beam, middle_Pa
        logs = np.log(middle_Pa) + np.linspace(-_SPAN, _SPAN, _MODULI)
        self._load_logs = _LOAD_LOGS if beam.loads.field_T.any() else np.zeros(1)
        loads = len(self._load_logs)
        motion, _ = beam.vibration(beam.planar()).about(
            beam.law,
            beam.parameters(np.exp(np.tile(logs, loads))),
            beam.loads,
            field_factor=np.exp(np.repeat(self._load_logs, _MODULI)),
            shapes=_SHAPES,
            stiffenings=_STIFFENINGS,
        )
        is_sound = np.asarray(motion.sound.reshape(loads, _MODULI).all(axis=0))
        if not is_sound[_MODULI // 2 :].all():
            raise NoEquilibrium(f"the specimen has no stable equilibrium at a shear modulus of {middle_Pa:.3g} Pa")
        sound = np.flatnonzero(is_sound)
        ratios = _of_unit(_chebyshev_points())
        squares = squares_by_stiffening(motion.material, motion.rest, motion.mass, ratios, _MODES) / ratios[:, None]
        squares = squares.reshape(loads, _MODULI, _DEGREE + 1, _MODES)[:, sound]
        size = squares.mean(axis=2)
        self._size = scipy.interpolate.CubicSpline(logs[sound], np.log(size), axis=1)
        values = np.linalg.inv(chebvander(_chebyshev_points(), _DEGREE)) @ (squares / size[:, :, None])
        self._polynomials = scipy.interpolate.CubicSpline(logs[sound], values, axis=1)
        self.range_Pa = (float(np.exp(logs[sound[0]])), float(np.exp(logs[sound[-1]])))

    def roots(self, log_modulus: Array, ratio: Ratio, count: int = 3, load_log: Array | None = None) -> ComplexArray:
        """Return the complex rates s of the vibrations exp(s t) for many candidate laws, one row each."""
        # ``log_modulus`` (P,): ln(modulus at rest in Pa) of P laws. ``ratio``: function of the rates (P, count) that
        # returns the complex modulus divided by the modulus at rest. ``load_log`` (P,): logarithms of the factors on
        # the magnetic loads. The result is (P, count) in 1/s.
        softer = float(np.log(self.planar_over_solid_modulus))
        inside = np.clip(log_modulus + softer, *np.log(self.range_Pa))
        # Outside the table, the equilibrium is that at the end of the table. The factor ``beyond`` on the modulus of
        # the vibration accounts for the rest.
        beyond = np.exp(log_modulus + softer - inside)
        factor, size = (one[:count] for one in self._correction)
        planar = self._squares(inside, np.zeros(len(inside)) if load_log is None else load_log, count)

        def squares(stiffening: ComplexArray) -> ComplexArray:
            return size * planar(stiffening)

        def of_inside(s: ComplexArray) -> ComplexArray:
            return np.asarray(beyond[:, None] * factor * ratio(s))

        return fixed_point(squares, of_inside, (len(inside), min(count, _MODES)))

    def _squares(self, log_modulus: Array, load_log: Array, count: int) -> Ratio:
        # The result is a function of the ratio of the dynamic to the static modulus: the squared angular frequencies of
        # the planar model. ``log_modulus``, ``load_log`` (P,): logarithms of P static moduli, and of factors on the
        # magnetic loads. ``count``: number of modes.
        each = np.exp(self._size(log_modulus))[:, :, None] * self._polynomials(log_modulus)
        polynomials = np.einsum("pf,fpdk->pdk", _lagrange(self._load_logs, load_log), each)
        columns = polynomials[..., :count].swapaxes(0, 1)

        def squares(stiffening: ComplexArray) -> ComplexArray:
            return np.asarray(stiffening * chebval(_in_unit(stiffening), columns, tensor=False))

        return squares

    @cached_property
    def _correction(self) -> tuple[Array, Array]:
        # For each mode of the planar model, a factor on the dynamic modulus and one on the squared frequency. With
        # them, lambda at both `_RATIOS` is that of the three-dimensional model or finer mesh.
        at = np.clip(np.log([self.middle_Pa * self.planar_over_solid_modulus]), *np.log(self.range_Pa))
        squares = self._squares(at, np.zeros(1), _MODES)

        def logs(log_factors: Array) -> Array:
            # ln(squared angular frequency) of three modes at both `_RATIOS`, (3, 2), with a factor on the modulus
            ratios = np.outer(_RATIOS, np.exp(log_factors)).astype(complex)
            return np.stack([np.log(np.real(squares(one[None]))[0]) for one in ratios], axis=1)

        of_solid = np.log(self._better[2])
        log_factors = np.zeros(_MODES)
        for _ in range(_CORRECTIONS):
            growth = np.diff(logs(log_factors))[:, 0]
            slope = (np.diff(logs(log_factors + _STEP))[:, 0] - growth) / _STEP
            gap = np.diff(of_solid)[:, 0] - growth
            log_factors = np.clip(log_factors + gap * slope / (slope**2 + _NO_SLOPE**2), -_LARGEST, _LARGEST)
        return np.exp(log_factors), np.exp(of_solid - logs(log_factors))[:, 0]

    @property
    def solid_over_planar(self) -> Array:
        """The lowest frequencies of the three-dimensional model, divided by those of the planar model."""
        # For a section that is not solid, a planar model with a finer mesh takes the place of this model.
        return self._better[0]

    @property
    def planar_over_solid_modulus(self) -> float:
        """The factor on the modulus with which the planar model bends as far as the three-dimensional model."""
        return self._better[1]

    def solid_over_stated_modulus(self) -> float:
        """Return the factor by which the identified modulus would change with a three-dimensional model of the beam."""
        if self.beam.specimen.section == "solid":
            return 1.0
        solid = RingTable(replace(self.beam, specimen=replace(self.beam.specimen, section="solid")), self.middle_Pa)
        stated_Hz, solid_Hz = (
            float(table.beam.undamped_Hz(self.middle_Pa, 1)[0] * table.solid_over_planar[0]) for table in (self, solid)
        )
        stiffer_Hz = float(self.beam.undamped_Hz(1.05 * self.middle_Pa, 1)[0])
        gain = np.log(1.05) / np.log(stiffer_Hz / self.beam.undamped_Hz(self.middle_Pa, 1)[0])
        return float((stated_Hz / solid_Hz) ** gain)

    @cached_property
    def fixed_weight_log(self) -> float:
        """The difference in ln(frequency) between a weight that is fixed to the tip and one that hangs by a thread."""
        # A weight on a thread follows the tip only along gravity.
        beam = self.beam
        if not beam.hanging_N:
            return 0.0
        fixed = Vibration(beam.planar(), beam.hanging_N / STANDARD_GRAVITY)
        motion, _ = fixed.about(beam.law, beam.parameters(np.array([self.middle_Pa])), beam.loads)
        return float(np.log(motion.frequencies_Hz(1)[0, 0] / beam.undamped_Hz(self.middle_Pa, 1)[0]))

    @cached_property
    def _better(self) -> tuple[Array, float, Array]:
        """The results of a more accurate beam model with which the planar model is corrected."""
        # 1. Its three lowest frequencies, divided by those of the planar model. 2. The factor on the modulus with which
        # the planar model bends as far as the more accurate model. 3. Its squared angular frequencies for three modes
        # and two moduli, (3, 2).
        # The two moduli are the modulus times each of `_RATIOS`.
        beam, parameters = self.beam, self.beam.parameters(np.array([self.middle_Pa]))
        planar = beam.planar()
        plain, _ = beam.vibration(planar).about(beam.law, parameters, beam.loads)
        if beam.specimen.section != "solid":
            finer, _ = beam.vibration(planar.refined()).about(
                beam.law, parameters, beam.loads, stiffenings=_STIFFENINGS
            )
            return finer.frequencies_Hz()[0] / plain.frequencies_Hz()[0], 1.0, _eigenvalues(finer)
        beside = SolidBeside(beam.specimen, *_SOLID)
        bent = beside.solve(
            beam.law, parameters, beam.loads, tolerance_mm=_SOLID_MM, options=SolidOptions(method="follow")
        )
        if not bent.converged.all():
            raise NoEquilibrium(
                f"the solid model of the beam has no equilibrium at a shear modulus of {self.middle_Pa:.3g} Pa"
            )
        chosen = candidates(beam.law, parameters, "solid", None, None)
        better = beam.vibration(beside.solid).near(chosen, beam.loads, bent.last, stiffenings=_STIFFENINGS)
        factors, turned_deg = self._finer_over_coarse(beside.planar, parameters)
        of_solid = float(beside.tip_angle_deg(bent)[0, 0]) + turned_deg
        moduli = self.middle_Pa * np.array([1.0, 1.05])
        of_planar = planar.tip_angle_deg(planar.solve(beam.law, beam.parameters(moduli), beam.loads))[:, 0]
        change = float(of_planar[1] - of_planar[0])
        stiffer = np.log(1.05) * (of_solid - of_planar[0]) / change if abs(change) > _LEAST_TURN_DEG else 0.0
        ratio = better.frequencies_Hz()[0] * np.sqrt(factors[:, 0]) / plain.frequencies_Hz()[0]
        return np.asarray(ratio), float(np.exp(stiffer)), _eigenvalues(better) * factors

    def _finer_over_coarse(self, coarse: BeamModel, parameters: Array) -> tuple[Array, float]:
        """Return how much a finer mesh changes the frequencies and the rotation of the tip."""
        # The squared frequencies of the fine mesh divided by those of the coarse mesh, (3, 2) for three modes and two
        # moduli, and the difference of the rotations in degrees.
        # The two moduli are the modulus times each of `_RATIOS`. The mesh of the three-dimensional model is as coarse
        # as that of ``coarse``.
        beam, fine = self.beam, BeamModel(coarse.specimen, coarse.along, _FINE_ACROSS, coarse.plane)
        squares, turned = [], []
        for model in (coarse, fine):
            shapes = model.solve(beam.law, parameters, beam.loads, tolerance_mm=_SOLID_MM)
            if shapes.status.any():
                return np.ones((_MODES, len(_RATIOS))), 0.0
            chosen = candidates(beam.law, parameters, model.plane, None, None)
            motion = beam.vibration(model).near(chosen, beam.loads, shapes.last, stiffenings=_STIFFENINGS)
            squares.append(_eigenvalues(motion))
            turned.append(float(model.tip_angle_deg(shapes)[0, 0]))
        return squares[1] / squares[0], turned[1] - turned[0]

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of ln(frequency) if an uncertain input, such as the width, changes by its uncertainty."""
        # ``sources``: the standard uncertainties of the inputs. The results are (components of the input, 3) for three
        # modes.
        before = np.log(self.beam.undamped_Hz(self.middle_Pa))
        return {key: self._effect(key, sigma, before) for key, sigma in sources.items()}

    def _effect(self, key: str, sigma: float, before: Array) -> Array:
        effect = np.zeros((len(SOURCES[key].parts), 3))
        for part, beam in enumerate(self.beam.changed_by(key, sigma)):
            effect[part] = np.log(beam.undamped_Hz(self.middle_Pa)) - before
        return effect


def _eigenvalues(motion: ReducedMotion) -> Array:
    """Return the squared angular frequencies of the first modes for several dynamic moduli."""
    # (3, 2) in 1/s²: three modes, and the modulus times each of `_RATIOS`.
    ratios = np.array(_RATIOS)
    squares = squares_by_stiffening(motion.material, motion.rest, motion.mass, ratios, _MODES)
    return np.asarray(squares[0].T)


def _lagrange(nodes: Array, at: Array) -> Array:
    """Evaluate all Lagrange polynomials of given nodes at many points, one row for each point."""
    values = np.ones((len(at), len(nodes)))
    for k, node in enumerate(nodes):
        for other in np.delete(nodes, k):
            values[:, k] *= (at - other) / (node - other)
    return values


def _chebyshev_points() -> Array:
    return np.asarray(np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)))


def _of_unit(x: Array) -> Array:
    # The ratio of the dynamic to the static modulus for a coordinate ``x`` from -1 to 1.
    return np.asarray(2.0 * _LEAST_RATIO / (x + 1.0))


def _in_unit(ratio: ComplexArray) -> ComplexArray:
    return np.asarray(2.0 * _LEAST_RATIO / ratio - 1.0)
