"""After its correction by the solid beam model, the modulus of a fit has a stated error that is never zero."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.evidence.corrections import SOLID
from eimi_fitting.inference.interval import corrected_optimum

PERCENT = 10.0
"""Change of the modulus (per cent) for a change of the first unknown by 1."""


def at(unit: float, error_mm: float = 0.01) -> Any:
    return SimpleNamespace(unit=np.array([unit]), evaluation=SimpleNamespace(objective_mm=np.array([error_mm])))


def corrected(monkeypatch: pytest.MonkeyPatch, *optima: Any) -> tuple[Any, list[Any]]:
    # Correct a fit by the solid beam model; return its optimum and the effect of the correction.
    # optima : stand-ins for the optimum after each pass of the correction; the optimum before the first pass is 0
    passes = iter(optima)
    problem: Any = SimpleNamespace(
        experiments=(), unknowns=SimpleNamespace(modulus_percent=lambda move: PERCENT * float(move))
    )
    monkeypatch.setattr(corrected_optimum, "replace", lambda value, **changes: value)
    monkeypatch.setattr(corrected_optimum, "_change", lambda *_: SimpleNamespace(added=lambda experiments: experiments))
    monkeypatch.setattr(corrected_optimum, "_with_change", lambda changed, now, optimum: (changed, next(passes)))
    _, optimum, effects = corrected_optimum._with_depth(problem, at(0.0))
    return optimum, list(effects)


def test_a_correction_that_converges_leaves_a_share_of_its_effect_and_at_least_a_fixed_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    optimum, (effect,) = corrected(monkeypatch, at(0.5), at(0.504))
    assert optimum.unit == pytest.approx([0.504])
    assert effect.moved == pytest.approx([0.504])
    assert (effect.share, effect.least_percent) == (0.05, 0.15)


def test_the_last_change_of_a_correction_that_does_not_converge_remains_uncertain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    optimum, (effect,) = corrected(monkeypatch, at(0.5), at(0.9), at(0.6))
    assert optimum.unit == pytest.approx([0.6])
    assert effect.share == pytest.approx(max(0.3 / 0.6, SOLID.remaining_share))
    assert effect.least_percent == 0.15


def test_a_pass_that_increases_the_error_is_not_accepted_and_its_change_remains_uncertain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    optimum, (effect,) = corrected(monkeypatch, at(0.5), at(0.9, error_mm=0.02))
    assert optimum.unit == pytest.approx([0.5])
    assert effect.share == pytest.approx(max(0.4 / 0.5, SOLID.remaining_share))


def test_without_an_equilibrium_of_the_solid_there_is_no_correction(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corrected_optimum, "_change", lambda *_: None)
    problem: Any = SimpleNamespace(experiments=(), unknowns=None)
    start = at(0.3)
    assert corrected_optimum._with_depth(problem, start) == (problem, start, [])
