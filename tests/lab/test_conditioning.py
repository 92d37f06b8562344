"""Conditioning cycles (bending before a run) have the right currents, stored frames and messages."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.heating import hottest
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import CoilRating
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError

THREE_CYCLES = "conditioning = { cycles = 3, current_A = 0.3 }"
TIP_PX = 84.5


def add_to_protocol(setup: Any, line: str) -> None:
    setup.protocol = parse(Protocol, f"{line}\n{setup.protocol.text}", "p")


def reached(setup: Any) -> list[float]:
    # Return a list that collects the set-points (A) from now on, without repetitions.
    history: list[float] = []
    take = setup.coil.set_current

    def watch(current_A: float) -> bool:
        if history[-1:] != [current_A]:
            history.append(current_A)
        return take(current_A)

    setup.coil.set_current = watch
    return history


def softening(draw: Callable[..., np.ndarray], history: list[float]) -> Callable[..., np.ndarray]:
    # Return a function that draws a beam whose tip moves 2 px farther at 0.3 A after the first cycle.
    # history: the set-points (A) so far.
    def drawn(seed: int, shift_px: float = 0.0) -> np.ndarray:
        softened = 0.0 in history[history.index(0.3) :] if 0.3 in history else False
        beam = draw(seed, shift_px + 2.0 * softened * (history[-1] / 0.3 if history else 0.0))
        there = 1 / (1 + np.exp((np.arange(len(beam)) - TIP_PX) / 0.7))[:, None]
        return (there * beam + (1 - there) * draw(seed + 10_000, 1e6)).astype(np.uint8)

    return drawn


def test_cycles_come_before_the_states_and_their_last_frames_are_stored(setup: Any) -> None:
    add_to_protocol(setup, THREE_CYCLES)
    history, remarks = reached(setup), []
    setup.run(remark=remarks.append)
    cycle = [0.1, 0.2, 0.3, 0.2, 0.1, 0.0]
    assert [round(value, 3) for value in history][:22] == [0.0, *cycle * 3, 0.1, 0.2, 0.3]
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    with open_dataset(setup.path) as dataset:
        shapes = dataset.conditioning()
    assert shapes is not None
    assert shapes.belongs_to.tolist() == [1, 1, 3, 3]
    assert shapes.set_A.tolist() == [0.0, 0.3, 0.3, 0.0]
    assert len(remarks) == 1
    assert remarks[0].startswith("after 3 conditioning cycles: at 0.3 A ")


def test_a_beam_that_softens_is_detected_by_its_tip(setup: Any) -> None:
    add_to_protocol(setup, THREE_CYCLES)
    setup.camera.draw = softening(setup.camera.draw, reached(setup))
    remarks: list[str] = []
    setup.run(remark=remarks.append)
    words = remarks[0].split(": at 0.3 A the tip is ")[1]
    assert float(words.split()[0]) == pytest.approx(2.0 / 8.0, abs=0.02)  # mm, at 8 px/mm
    assert "px) from its position in cycle 1" in words
    assert words.endswith("at 0 A the tip is within 0.2 px of its position before cycle 1")


def test_a_picture_without_a_beam_is_compared_as_an_image(setup: Any) -> None:
    add_to_protocol(setup, THREE_CYCLES)
    setup.camera.draw = lambda seed, shift: np.random.default_rng(seed).normal(120, 3, (96, 128)).astype(np.uint8)
    remarks: list[str] = []
    setup.run(remark=remarks.append)
    printed_motion = re.search(
        r"at 0\.3 A the tip of the beam is not visible; the image differs from the image in cycle 1 by ([\d.]+) times",
        remarks[0],
    )
    assert printed_motion
    assert float(printed_motion[1]) == pytest.approx(1.0, abs=0.05)
    assert setup.is_off()


def test_a_resumed_run_is_not_conditioned_again(setup: Any) -> None:
    add_to_protocol(setup, THREE_CYCLES)
    setup.run()
    with open_dataset(setup.path) as dataset:
        before = dataset.conditioning()
    setup.path.unlink()

    def fail(live: Any) -> None:
        if live.state == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        setup.run(show=fail)
    history = reached(setup)
    setup.run(resume=True)
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert [round(value, 3) for value in history][:4] == [0.0, 0.1, 0.2, 0.3]
    assert max(history) == 0.3
    with open_dataset(setup.path) as dataset:
        after = dataset.conditioning()
    assert before is not None
    assert after is not None
    assert after.set_A.tolist() == before.set_A.tolist()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "conditioning = { cycles = 3, current_A = 1.5 }",
            r"conditioning\.current_A goes to 1\.5 A, which exc",
        ),
        ("conditioning = { cycles = 3, current_A = 0.0 }", "conditioning.current_A = 0.0 does not move the beam"),
        ("conditioning = { cycles = 0, current_A = 0.3 }", "conditioning.cycles = 0 should be"),
    ],
)
def test_a_conditioning_that_is_impossible_is_refused(setup: Any, line: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        add_to_protocol(setup, line)


def test_limits_and_poles_of_the_rig_hold_for_the_conditioning(setup: Any) -> None:
    add_to_protocol(setup, "conditioning = { cycles = 2, current_A = 0.9 }")
    tight = setup.rig.supply.model_copy(
        update={"limits": setup.rig.supply.limits.model_copy(update={"current_A": 0.8})}
    )
    with pytest.raises(InputError, match=r"conditioning\.current_A goes to 0\.9 A; rig bench allows"):
        replace(setup, rig=setup.rig.model_copy(update={"supply": tight})).run()
    setup.protocol = parse(Protocol, setup.protocol.text.replace("current_A = 0.9 }", "current_A = -0.3 }"), "p")
    with pytest.raises(InputError, match=r"conditioning\.current_A goes to -0\.3 A, but supply\.driver = 'korad'"):
        setup.run()
    assert setup.camera.number == 0


def test_heat_and_time_count_the_cycles(setup: Any) -> None:
    rating = CoilRating(continuous_current_A=0.3, thermal_time_constant_s=30.0)
    messages: dict[bool, list[str]] = {False: [], True: []}
    shares = []
    for conditioned in (False, True):
        if conditioned:
            add_to_protocol(setup, "conditioning = { cycles = 20, current_A = 0.9 }")
        shares.append(hottest(setup.protocol, rating))
        dry_run(setup.protocol, setup.specimen, setup.rig, messages[conditioned].append)
    assert shares[1].share > 2 * shares[0].share
    assert shares[1].stage.startswith("conditioning cycle ")
    assert "conditioning: 20 cycles to 0.9 A and back to 0" in messages[True]
    seconds = [int(messages[conditioned][-1].split()[1]) for conditioned in (False, True)]
    assert seconds[1] > seconds[0] + 20
