"""The frequencies and loss factors of a specimen's vibrations, as functions of shear modulus and relaxation.

A fit needs these functions for many candidate laws. They are therefore computed once as a table and interpolated. Two
moduli matter:

- The equilibrium modulus is the shear modulus with which the static equilibrium is computed. The modes
  (`beam.vibration`) are computed for a few equilibrium moduli, and interpolated in the logarithm of this modulus.
- A vibration is proportional to exp(s t) with the complex rate s. Its modulus is the equilibrium modulus times a
  complex ratio r(s), and s follows from s² = -lambda(r(s)). Here lambda(r) is the eigenvalue of a mode for the ratio r;
  for a real r it is the squared angular frequency. It is computed for a few real ratios r. The values of lambda/r are
  interpolated by a polynomial in 1/r, which then gives lambda for any complex r.

The modes are computed with a planar model and corrected by three factors, because the solid model is more accurate. The
first factor multiplies the equilibrium modulus, so that the planar model bends like the solid model. The second
multiplies the ratio r of a mode, and the third the eigenvalue of the mode. These two are chosen so that the mode has
the frequency of the solid model at two values of r. The solid model has a coarse mesh. What a finer mesh changes is
computed with the planar model. All factors are computed once, at the middle of the equilibrium moduli.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebval, chebvander
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.loads import Loads
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
    """The frequencies and decay rates of a specimen for any viscoelastic law near a given modulus.

    The equilibrium modulus is the shear modulus with which the equilibrium under the loads is computed.

    Parameters
    ----------
    beam : RingingBeam
        The specimen under its loads.
    middle_Pa : float
        The middle of the equilibrium moduli for which the modes are computed.

    Raises
    ------
    NoEquilibrium
        The specimen has no stable equilibrium with ``middle_Pa``, or with a larger modulus of the table.
    """

    def __init__(self, beam: RingingBeam, middle_Pa: float) -> None:
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
        """Return the complex rates s of the vibrations exp(s t) of P candidate laws, (P, count) in 1/s.

        Parameters
        ----------
        log_modulus : ndarray, shape (P,)
            Logarithm of the equilibrium modulus in Pa.
        ratio : callable
            The function r(s): takes rates s (P, count), and returns the complex modulus divided by the equilibrium
            modulus.
        count : int
            Number of modes, at most 3.
        load_log : ndarray, shape (P,), optional
            Logarithm of a factor on the magnetic loads.
        """
        softer = float(np.log(self.planar_over_solid_modulus))
        inside = np.clip(log_modulus + softer, *np.log(self.range_Pa))
        beyond = np.exp(log_modulus + softer - inside)  # outside the table only the equilibrium is that at its end
        factor, size = (one[:count] for one in self._correction)
        planar = self._squares(inside, np.zeros(len(inside)) if load_log is None else load_log, count)

        def squares(stiffening: ComplexArray) -> ComplexArray:
            return size * planar(stiffening)

        def of_inside(s: ComplexArray) -> ComplexArray:
            return np.asarray(beyond[:, None] * factor * ratio(s))

        return fixed_point(squares, of_inside, (len(inside), min(count, _MODES)))

    def _squares(self, log_modulus: Array, load_log: Array, count: int) -> Ratio:
        """Return the function that computes squared angular frequencies of the planar model, (P, count).

        Its argument is the modulus in the vibration divided by the equilibrium modulus, (P, count). log_modulus:
        logarithms of P equilibrium moduli, (P,). load_log: logarithms of P factors on the magnetic loads, (P,).
        """
        each = np.exp(self._size(log_modulus))[:, :, None] * self._polynomials(log_modulus)
        polynomials = np.einsum("pf,fpdk->pdk", _lagrange(self._load_logs, load_log), each)
        columns = polynomials[..., :count].swapaxes(0, 1)

        def squares(stiffening: ComplexArray) -> ComplexArray:
            return np.asarray(stiffening * chebval(_in_unit(stiffening), columns, tensor=False))

        return squares

    @cached_property
    def _correction(self) -> tuple[Array, Array]:
        """Factors that give three planar modes of vibration the frequencies of the solid model, two arrays (3,).

        The first factor of a mode multiplies the shear modulus of the beam, and the second the squared frequency.
        """
        at = np.clip(np.log([self.middle_Pa * self.planar_over_solid_modulus]), *np.log(self.range_Pa))
        squares = self._squares(at, np.zeros(1), _MODES)

        def logs(log_factors: Array) -> Array:
            """Return ln(squared angular frequency) of three planar modes at two moduli, (3, 2).

            log_factors: for each mode, the logarithm of a factor on the modulus in the vibration.
            """
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
        """The three lowest frequencies of the solid model, divided by those of the planar model, (3,)."""
        return self._better[0]

    @property
    def planar_over_solid_modulus(self) -> float:
        """The factor on the modulus with which the planar model bends as far as the solid model."""
        return self._better[1]

    def solid_over_stated_modulus(self) -> float:
        """Return the factor by which the identified modulus would change if the section were solid.

        The stated section is the one in the specimen file, for example plane strain.
        """
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
        """The change of ln(frequency) if the hanging weight moved with the tip in all directions; 0 without a weight.

        A weight on a thread moves with the tip along gravity only.
        """
        beam = self.beam
        if not beam.hanging_N:
            return 0.0
        fixed = Vibration(beam.planar(), beam.hanging_N / STANDARD_GRAVITY)
        motion, _ = fixed.about(beam.law, beam.parameters(np.array([self.middle_Pa])), beam.loads)
        return float(np.log(motion.frequencies_Hz(1)[0, 0] / beam.undamped_Hz(self.middle_Pa, 1)[0]))

    @cached_property
    def _better(self) -> tuple[Array, float, Array]:
        """Three comparisons of the solid model with the planar model: frequencies, modulus, and squared frequencies.

        They are: three frequencies divided by those of the planar model, (3,); the factor on the modulus with which the
        planar model bends as far; squared angular frequencies of three modes at two moduli, (3, 2) in 1/s².
        """
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
        """Return how a finer mesh across the beam would change the solid model: its frequencies and its bending.

        Parameters
        ----------
        coarse : BeamModel
            A planar model with the elements of the solid model along and across the beam.
        parameters : ndarray, shape (1, n)
            The parameters of the law.

        Returns
        -------
        factors : ndarray, shape (3, 2)
            Factors on the eigenvalues (squared angular frequencies) of three modes at two moduli.
        turn_deg : float
            Change of the rotation of the tip in degrees. The results are 1 and 0 if a planar model has no equilibrium.
        """
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
        """Return the changes of ln(frequency) of three modes if uncertain inputs change by their uncertainties.

        Parameters
        ----------
        sources : mapping of str to float
            Standard uncertainties of the inputs, such as the width of the beam, by name. Only one input changes at a
            time, by its standard uncertainty.

        Returns
        -------
        dict of ndarray, shape (components, 3)
            For each input, one row for each of its components and one column for each of the three modes. An input has
            several components if it is a vector, such as a background field. Zero for an input that changes neither the
            specimen nor its loads.
        """
        before = np.log(self.beam.undamped_Hz(self.middle_Pa))
        return {key: self._effect(key, sigma, before) for key, sigma in sources.items()}

    def _effect(self, key: str, sigma: float, before: Array) -> Array:
        source = SOURCES[key]
        effect = np.zeros((len(source.parts), 3))
        if sigma and (source.specimen or source.loads):
            for part in range(len(source.parts)):
                deviation = np.zeros(len(source.parts))
                deviation[part] = sigma
                effect[part] = np.log(self.beam.under({key: deviation}).undamped_Hz(self.middle_Pa)) - before
        if source.field and sigma and self.beam.loads.field_T.any():
            changed = RingingBeam(
                self.beam.specimen,
                Loads(
                    self.beam.loads.field_T * (1 + sigma),
                    self.beam.loads.gravity,
                    self.beam.loads.tip_force_N,
                    coil=self.beam.loads.coil,
                ),
                self.beam.law,
                self.beam.shape,
                self.beam.hanging_N,
            )
            effect[0] = np.log(changed.undamped_Hz(self.middle_Pa)) - before
        return effect


def _eigenvalues(motion: ReducedMotion) -> Array:
    """Return the squared angular frequencies of three modes at two moduli, (3, 2) in 1/s².

    The moduli in the vibration are 0.9 and 1.2 times the static modulus.
    """
    ratios = np.array(_RATIOS)
    squares = squares_by_stiffening(motion.material, motion.rest, motion.mass, ratios, _MODES)
    return np.asarray(squares[0].T)


def _lagrange(nodes: Array, at: Array) -> Array:
    """Evaluate F Lagrange polynomials at P points, (P, F).

    Each polynomial is 1 at one of F nodes and 0 at the other nodes.
    """
    values = np.ones((len(at), len(nodes)))
    for k, node in enumerate(nodes):
        for other in np.delete(nodes, k):
            values[:, k] *= (at - other) / (node - other)
    return values


def _chebyshev_points() -> Array:
    return np.asarray(np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)))


def _of_unit(x: Array) -> Array:
    """Convert a variable, -1 < x <= 1, to the modulus in a vibration divided by the equilibrium modulus.

    The frequencies are interpolated by polynomials in this variable.
    """
    return np.asarray(2.0 * _LEAST_RATIO / (x + 1.0))


def _in_unit(ratio: ComplexArray) -> ComplexArray:
    return np.asarray(2.0 * _LEAST_RATIO / ratio - 1.0)
