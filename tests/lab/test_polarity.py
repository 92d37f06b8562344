"""A run measures with both signs of the current; if the supply cannot reverse it, the leads of the coil are swapped."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import h5py
import numpy as np
import pytest

import eimi_lab as eimi
from eimi_drivers.interfaces import InstrumentDisconnected
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import Event, Paused, Warned
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.polarity import Polarity
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.materials import TrueMaterials
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.segmentation import segment
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.process.stopping import Stopped
from tests.lab.test_resuming import ring_downs_from, stop_after_a_ring_down

BOTH = (0.0, 0.1, 0.2, 0.3, -0.1, -0.2, -0.3)


def with_both(protocol: Protocol, more: str = "") -> Protocol:
    return parse(Protocol, protocol.text.replace("[current]", f"[current]\nboth_polarities = true\n{more}"), "protocol")


@pytest.fixture
def bench(setup: Any) -> Any:
    # A bench whose supply cannot reverse its current, with a protocol of both signs of the current.
    setup.protocol = with_both(setup.protocol)
    return setup


def person(setup: Any, answered: list[bool]) -> Callable[[], str | None]:
    # Return a replacement for a user who swaps the leads of the coil when the run asks for it.
    # answered: receives, each time the run reads the keyboard while the output is off, whether the set-point is zero.
    def typed() -> str | None:
        if setup.coil.state.output:
            return None
        answered.append(setup.is_off())
        return "" if len(answered) % 5 == 0 else None  # the first answer comes after the run has started to wait

    return typed


def test_a_line_that_was_typed_before_the_request_to_swap_the_leads_does_not_count(bench: Any) -> None:
    looks: list[bool] = []

    def typed() -> str | None:
        if bench.coil.state.output:
            return None
        looks.append(bench.is_off())
        return "" if len(looks) % 5 in (0, 1) else None  # the first line was typed before the pause begins

    bench.run(typed=typed, remark=lambda words: None)
    assert all(looks)
    assert len(looks) % 5 == 0
    assert looks


@pytest.mark.parametrize(
    ("currents", "expected"),
    [
        ("start_A = 0.0\nstop_A = 0.3\nstep_A = 0.1", BOTH),
        ("values_A = [0.2, 0.1]", (0.2, 0.1, -0.2, -0.1)),
        ("values_A = [0.0, 0.2]\nup_and_down = true", (0.0, 0.2, 0.0, -0.2)),
    ],
)
def test_the_states_are_repeated_with_the_current_reversed(texts: dict[str, str], currents: str, expected: Any) -> None:
    text = texts["protocol"].replace("start_A = 0.0\nstop_A = 0.3\nstep_A = 0.1", f"{currents}\nboth_polarities = true")
    assert parse(Protocol, text, "protocol.toml").currents_A == expected


def test_both_polarities_of_a_negative_current_are_refused(texts: dict[str, str]) -> None:
    text = texts["protocol"].replace("start_A = 0.0", "start_A = -0.3\nboth_polarities = true")
    with pytest.raises(InputError, match=r"repeats every state with the opposite current, but one current is -0\.3 A"):
        parse(Protocol, text, "protocol.toml")


def test_a_person_swaps_the_leads_in_a_pause_and_the_states_have_their_sign(bench: Any) -> None:
    set_A: list[float] = []
    take = bench.coil.set_current
    bench.coil.set_current = lambda current_A: set_A.append(current_A) or take(current_A)
    events: list[Event] = []
    answered: list[bool] = []
    bench.run(on_event=events.append, remark=lambda words: None, typed=person(bench, answered))
    assert bench.stored() == list(BOTH)
    assert min(set_A) >= 0.0
    assert all(answered)
    (pause,) = [event for event in events if isinstance(event, Paused)]
    assert (pause.state, pause.swap_leads) == (4, True)
    assert "swap its two leads at the supply before state 4" in in_words(pause)
    (warning,) = [event for event in events if isinstance(event, Warned)]
    assert "the leads of the coil are still swapped" in warning.message
    assert bench.is_off()
    with open_dataset(bench.path) as dataset:
        assert [state.field_mT for state in dataset.states] == pytest.approx([4.7 * current for current in BOTH])
    with h5py.File(bench.path) as file:
        measured = [name for name in file["entry/data"] if "current" in name]
        values = file["entry/data"][measured[0]][()]
        assert values.min() == pytest.approx(-0.3, abs=0.01)


def test_a_resumed_run_asks_for_the_leads_first_and_passes_through_the_states_of_its_polarity(bench: Any) -> None:
    def unplug(number: int) -> None:
        if bench.coil.state.set_current_A == 0.3 and len(passed) > 1:
            raise InstrumentDisconnected("memory: unplugged")

    passed: list[Event] = []
    bench.camera.event = unplug

    def listen(event: Event) -> None:
        if isinstance(event, Paused):
            passed.extend([event, event])

    with pytest.raises(InstrumentDisconnected):
        bench.run(on_event=listen, remark=lambda words: None, typed=person(bench, []))
    assert bench.stored() == list(BOTH[:-1])
    bench.camera.event = lambda number: None
    set_A: list[float] = []
    take = bench.coil.set_current
    bench.coil.set_current = lambda current_A: set_A.append(current_A) or take(current_A)
    events: list[Event] = []
    bench.run(on_event=events.append, remark=lambda words: None, typed=person(bench, []), resume=True)
    assert [event.state for event in events if isinstance(event, Paused)] == [6]
    assert bench.stored() == list(BOTH)
    assert [value for value in set_A if value][:3] == [0.1, 0.2, 0.3]


def test_the_leads_are_swapped_before_the_missing_ring_downs_of_a_resumed_run(bench: Any) -> None:
    text = f"ring_down = {{ seconds = 0.1, repeats = 2, from_A = -0.2 }}\n{bench.protocol.text}"
    bench.protocol = parse(Protocol, text, "protocol")
    with pytest.raises(Stopped):
        bench.run(on_event=stop_after_a_ring_down, remark=lambda words: None, typed=person(bench, []))
    events: list[Event] = []
    bench.run(on_event=events.append, remark=lambda words: None, typed=person(bench, []), resume=True)
    (pause,) = [event for event in events if isinstance(event, Paused)]
    assert (pause.state, pause.states, pause.swap_leads) == (7, 7, True)
    assert "swap its two leads at the supply before the ring-downs" in in_words(pause)
    assert ring_downs_from(bench.path) == [-0.2, -0.2]


def test_a_run_without_a_terminal_is_refused_before_anything_is_switched_on(bench: Any) -> None:
    with pytest.raises(InputError, match="a person has to swap the leads; start the run on a terminal"):
        bench.run()
    assert not bench.path.exists()


def test_a_dry_run_shows_the_pause_and_sends_no_negative_current(bench: Any) -> None:
    lines: list[str] = []
    dry_run(bench.protocol, bench.specimen, bench.rig, lines.append)
    assert sum("the coil is off while a person swaps the leads of the coil" in line for line in lines) == 1
    assert not any("-0." in line for line in lines if ">" in line)


def test_a_bipolar_supply_reverses_its_current_without_a_pause(bench: Any) -> None:
    supply = bench.rig.supply.model_copy(update={"driver": "kepco-bop", "address": "GPIB0::6::INSTR"})
    lines: list[str] = []
    dry_run(bench.protocol, bench.specimen, bench.rig.model_copy(update={"supply": supply}), lines.append)
    assert not any("swaps the leads" in line for line in lines)
    assert any("-0.3" in line for line in lines if "  > " in line)


def test_the_virtual_rig_reverses_its_field_and_the_edges_lie_on_the_other_side(tmp_path: Any) -> None:
    rig, specimen = load_rig("virtual"), load_specimen("type1")
    assert rig.virtual is not None
    rig = rig.model_copy(update={"virtual": rig.virtual.model_copy(update={"mesh": (8, 1, 1)})})
    quick = load_protocol("dragon_skin_10_quick").text.replace("step_A = 0.3 ", "step_A = 1.5 ")
    protocol = with_both(parse(Protocol, quick.replace("step_A = 0.3", "step_A = 1.5"), "quick"))
    assert protocol.currents_A == (0.0, 1.5, -1.5)
    path = tmp_path / "run.h5"
    with open_bench(rig, specimen, protocol.limits) as bench:
        acquire(protocol, specimen, rig, bench, path)
    segment(path, silent)
    experiment = load_evidence(path).experiment
    assert experiment.loads.field_T[:, 1] == pytest.approx([0.0, 7.05e-3, -7.05e-3], abs=1e-9)
    right, left = (experiment.observed.points_mm[k] for k in (1, 2))
    # The beam hangs, so that the shapes of both polarities are mirror images of each other.
    assert right[..., 1].max() == pytest.approx(-left[..., 1].min(), abs=0.02)
    assert right[..., 1].max() > 5.0
    assert np.isfinite(experiment.observed.sigma_mm).any()


@pytest.mark.slow
def test_a_hidden_tilt_of_the_moment_is_found_by_the_whole_chain_and_the_modulus_is_right(tmp_path: Any) -> None:
    # `tests/fitting/test_magnetisation_angle.py` contains a short version of this test without pictures.
    rig, exact = load_rig("virtual"), load_specimen("type1")
    assert rig.virtual is not None
    silicone = '[silicone."Dragon Skin 10"]\nmodel = "neo-hookean"\nparameters = { mu_Pa = 46390.0 }\n'
    hidden = parse(TrueMaterials, f"{silicone}[bench]\nmagnetisation_angle_deg = 3.0\n", "materials.toml")
    rig = rig.model_copy(update={"virtual": rig.virtual.model_copy(update={"materials": hidden})})
    stated = exact.text.replace("\nmagnetisation_angle_deg = 0.0", "\nmagnetisation_angle_deg = 3.0")
    specimen = parse(SpecimenFile, stated, "specimen.toml")
    protocol = with_both(load_protocol("dragon_skin_10_quick"))
    path = tmp_path / "run.h5"
    with open_bench(rig, specimen, protocol.limits) as bench:
        acquire(protocol, specimen, rig, bench, path)
    fit = eimi.fit(path, "neo-hookean")
    (freed,) = fit.freed
    assert freed.deviation.value == pytest.approx(3.0, abs=0.05)
    assert fit.initial_shear_modulus.value == pytest.approx(46390.0, rel=0.01)
    low, high = fit.initial_shear_modulus.interval_95
    assert low < 46390.0 < high


def test_a_relay_swaps_the_leads_without_current_and_the_run_goes_back_through_its_states() -> None:
    done: list[Any] = []
    coil = SimpleNamespace(
        leads_swapped=False,
        ramp_to=lambda current_A, stop: done.append(("ramp", current_A)),
        wait_until_reached=lambda stop: done.append("reached"),
    )
    run: Any = SimpleNamespace(
        protocol=SimpleNamespace(currents_A=[0.0, 0.5, -0.5]),
        coil=coil,
        go_back_to=lambda state, stop: done.append(("back to", state)),
    )
    polarity = Polarity(cast(Any, object()), lambda: done.append("relay"))
    assert not polarity.prepare(run, 0, lambda: None)
    assert not polarity.prepare(run, 1, lambda: None)
    assert done == []
    assert polarity.prepare(run, 2, lambda: None)
    assert done == [("ramp", 0.0), "reached", "relay", ("back to", 2)]
    assert coil.leads_swapped
    assert not polarity.prepare(run, 2, lambda: None)
    assert polarity.prepare(run, 1, lambda: None)
    assert not coil.leads_swapped
    assert not Polarity(None, lambda: done.append("relay")).prepare(run, 2, lambda: None)
