"""Test whether the residuals of a fit (distances of measured from simulated edges) look like noise."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.randomness import Randomness, randomness_of
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.shown import ShownFit


@dataclass(frozen=True)
class ResidualNoise:
    """The result of a test whether the residuals of a fit look like noise: a short answer, and the reason in sentences.

    The sizes of the random and the systematic part of the residuals (µm) are given as text.
    """

    answer: str
    words: str
    parts: str = ""


def residual_noise(simulated: Prediction[ShownFit]) -> ResidualNoise | None:
    """Test whether the distances of measured from simulated edges look like noise; None for tracked points."""
    if not isinstance(simulated.evidence.experiment.observed, EdgeObservation):
        return None
    tests = randomness_of(1e3 * simulated.residuals_mm)
    if not tests.decided:
        return ResidualNoise("too few points", f"Only {tests.pairs} pairs of neighbouring points could be tested.")
    parts = f"random part {tests.noise:.2g} µm"
    if not tests.is_noise:
        parts += f", systematic part {tests.systematic:.2g} µm"
    return ResidualNoise("yes" if tests.is_noise else "no", _words(tests), parts)


def _words(tests: Randomness) -> str:
    words = (
        f"In {100 * tests.sign_changes / tests.pairs:.0f} % of {tests.pairs} pairs of neighbouring edge points the "
        f"residuals differ in sign (noise: 50 %; runs test, {_probability(tests.runs_probability)}). The correlation "
        f"of the two residuals is {tests.autocorrelation:.2f} "
        f"(noise: 0; {_probability(tests.autocorrelation_probability)})."
    )
    if tests.is_noise:
        return f"{words} The random part is {tests.noise:.2g} µm (root mean square)."
    return (
        f"{words} The random part is {tests.noise:.2g} µm and the systematic part {tests.systematic:.2g} µm (root mean "
        "squares). The systematic part is an error of beam model, optics or inputs, which noise does not explain."
    )


def _probability(probability: float) -> str:
    return "p < 0.001" if probability < 0.001 else f"p = {probability:.2g}"
