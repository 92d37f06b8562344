"""The program refuses a run before it switches the coil on, if the supply cannot set a current of the run exactly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from eimi_lab.acquisition.current_steps import refuse_between_steps
from eimi_lab.acquisition.events import Event, StateStored, Warned
from eimi_lab.config.protocol import Currents
from eimi_lab.process.errors import InputError


def protocol(*currents_A: float) -> Any:
    return SimpleNamespace(name="p", currents_A=currents_A, ring_down=None)


def supply(step: str) -> Any:
    return SimpleNamespace(current_step_A=step)


@pytest.mark.parametrize(
    ("step", "currents_A", "words"),
    [
        ("0.01", (0.0, 0.309), r"state 1 is 0\.309 A, .* in steps of 0\.01 A; use 0\.3 or 0\.31 A$"),
        ("0.01", (0.0, 0.1, -0.309), r"state 2 is -0\.309 A, .*; use -0\.3 or -0\.31 A$"),
        ("0.001", (0.0305, 0.0), r"state 0 is 0\.0305 A, .* in steps of 0\.001 A; use 0\.03 or 0\.031 A$"),
    ],
)
def test_a_current_between_two_steps_is_refused_with_the_nearest_currents(
    step: str, currents_A: tuple[float, ...], words: str
) -> None:
    with pytest.raises(InputError, match=rf"^protocol p: the current at {words}"):
        refuse_between_steps(protocol(*currents_A), supply(step))


def test_multiples_of_the_step_are_accepted_also_with_rounding_errors() -> None:
    refuse_between_steps(protocol(0.1 + 0.2, 3 * 0.1, -7 * 0.1, 0.0), supply("0.01"))
    spaced = Currents(start_A=-1.5, stop_A=1.5, step_A=0.01, up_and_down=True).set_points_A
    refuse_between_steps(protocol(*spaced), supply("0.01"))
    refuse_between_steps(protocol(0.30951), SimpleNamespace())  # the step of this supply is not known


def test_a_run_between_the_steps_of_its_supply_never_switches_the_coil_on(setup: Any) -> None:
    setup.bench.supply.current_step_A = "0.2"
    with pytest.raises(InputError, match=r"the current at state 1 is 0\.1 A, but the supply sets its current in steps"):
        setup.run()
    assert not any(message.startswith(b"OUT1") for message in setup.bench.supply._link.sent)
    assert not setup.path.exists()


def test_a_run_that_an_earlier_version_began_between_the_steps_is_continued_with_a_warning(setup: Any) -> None:
    class Stopped(Exception):
        pass

    def stop(event: Event) -> None:
        if isinstance(event, StateStored) and event.state == 1:
            raise Stopped

    warnings: list[str] = []
    with pytest.raises(Stopped):
        setup.run(on_event=stop)
    setup.bench.supply.current_step_A = "0.015"  # 0.1 A becomes 0.09 A, within ramp.tolerance_A
    setup.run(resume=True, on_event=lambda event: warnings.append(event.message) if isinstance(event, Warned) else None)
    assert [words for words in warnings if "currents rounded toward zero" in words]
    assert len(setup.stored()) == len(setup.protocol.currents_A)


def test_a_ring_down_from_a_current_between_two_steps_is_refused() -> None:
    swings: Any = SimpleNamespace(name="p", currents_A=(0.0, 0.1), ring_down=object(), ring_down_from_A=0.309)
    with pytest.raises(InputError, match=r"at ring_down\.from_A is 0\.309 A, .*; use 0\.3 or 0\.31 A$"):
        refuse_between_steps(swings, supply("0.01"))


def test_a_step_may_be_a_number() -> None:
    refuse_between_steps(protocol(0.31), SimpleNamespace(current_step_A=0.01))  # type: ignore[arg-type]
