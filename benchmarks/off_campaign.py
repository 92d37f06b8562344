"""Measure how soon the coil is switched off from its full current (1.5 A), for every fault that can keep a coil on.

    python -m benchmarks.off_campaign --trials 5 [--fault NAME] [--list]

Each trial is an `eimi acquire` on an emulated supply, with a fault at a random moment. The table shows how long the
output stayed on, and how many stored states were lost. The time begins at the fault, or at the end of the supply's
silence if the fault makes the supply silent. The exit status is 0 if every trial met its time limit, lost no state and
reported the fault. `--list` prints the names of the faults.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.emulated_supply import LEAST_CHANGE_A
from benchmarks.off_faults import (
    FAULTS,
    Fault,
)
from benchmarks.spoilt_bench import LateAnswer, Supply, Trial, make_bench, wait_until
from eimi_drivers.supplies.off import LEAST_OFF_A as OFF_A
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from tests.shared.processes import WAIT_AT_MOST_S

STARTS_AT_MOST = 5
"""Number of times that a trial is started if the supply or the guardian answers too late before the fault begins."""


@dataclass
class Outcome:
    """The result of one trial.

    Attributes
    ----------
    on_for_s : float
        Time for which the output stayed on after the fault, s.
    acknowledged : int
        Number of states that the run reported as stored.
    lost : int
        Number of these states that are not in the file.
    wrong : list of str
        Descriptions of the requirements that were not met.
    """

    on_for_s: float
    acknowledged: int
    lost: int
    wrong: list[str]


def attempt(fault: Fault, after_s: float, patience: float) -> Outcome:
    """Start a measurement, cause a fault, and return how long the coil stayed on and how many states were lost.

    The fault comes `after_s` seconds after the full current. `patience` multiplies the time limit, for slow machines. A
    measurement that ends before the fault, because the computer is too busy, is repeated.
    """
    for _ in range(STARTS_AT_MOST - 1):
        with suppress(LateAnswer):
            return _attempt(fault, after_s, patience)
    return _attempt(fault, after_s, patience)


def _attempt(fault: Fault, after_s: float, patience: float) -> Outcome:
    # Raises LateAnswer if the run ends before the fault, because the supply or the guardian answered too late.
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_bench(folder)
        supply = Supply(fault.driver, fault.transport)
        trial = Trial(folder, supply, fault.unread)
        wrong: list[str] = []
        try:
            trial.begin()
            time.sleep(after_s)
            trial.require_running()
            began = fault.act(trial)
            try:
                if fault.out_of_reach:
                    on_for_s = trial.wait_for_words(fault.said, began) - began
                else:
                    wait_until(lambda: not supply.on(), "the coil was left on")
                    on_for_s = max(0.0, supply.off_s() - began)
                if fault.flows_on:
                    trial.wait_for_words(fault.said, began)
            except RuntimeError as error:
                on_for_s = time.monotonic() - began
                wrong.append(str(error))
            supply.tell("none")
            if trial.process.poll() is None and "SIGSTOP" in fault.name:
                trial.process.send_signal(signal.SIGCONT)
            if fault.out_of_reach:
                trial.process.wait(WAIT_AT_MOST_S)
                trial.end_guardian()
            trial.end()
            if supply.on() and not fault.out_of_reach:
                wrong.append("the coil is on again")
            wrong += _reported_off_too_early(trial)
        finally:
            if trial.process.poll() is None:
                trial.process.kill()
                trial.process.wait()
            supply.close()
        if on_for_s > fault.off_within_s * patience:
            wrong.append(f"off only after {on_for_s:.2f} s")
        if not re.search(fault.said, "\n".join(trial.lines), re.DOTALL):
            wrong.append(f"no word of {fault.said!r}")
        if fault.not_said and re.search(fault.not_said, "\n".join(trial.lines)):
            wrong.append(f"a word of {fault.not_said!r}")
        if "Traceback" in "\n".join(trial.lines):
            wrong.append("a traceback")
        stored = _stored(folder)
        lost = max(0, trial.acknowledged() - stored)
        if wrong:
            wrong += [f"    {line}" for line in trial.lines[-12:]]
        return Outcome(on_for_s, trial.acknowledged(), lost, wrong)


def _reported_off_too_early(trial: Trial) -> list[str]:
    """Return the messages that reported the coil as off while the current was above the limit."""
    # A message may state a limit ("off, below ... A measured"), which applies from this message on.
    early, limit_A = [], OFF_A
    for line, at_s in zip(trial.lines, trial.arrived_s, strict=True):
        true_A = trial.supply.true_A(at_s)
        limit_in_line = re.search(r"off, below (\S+) A measured", line)
        limit_A = float(limit_in_line[1]) if limit_in_line else limit_A
        if re.search("the coil (is|was switched) off", line) and abs(true_A) > limit_A + LEAST_CHANGE_A:
            early.append(f"called off at {true_A:.2f} A: {line}")
    return early


def _stored(folder: Path) -> int:
    path = folder / "run.h5"
    if not path.exists():
        return 0
    recover(path, folder / "whole.h5", say=lambda words: None)
    with open_dataset(folder / "whole.h5") as dataset:
        for state in dataset.states:
            dataset.images(state.index)
        return len(dataset.states)


def campaign(faults: list[Fault], trials: int, seed: int, patience: float) -> int:
    """Run several trials of each fault; print a table, and return the number of failed trials.

    `patience` multiplies the time limits, for slow machines.
    """
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGTSTP):
        signal.signal(number, signal.SIG_DFL)  # a child would inherit ignored signals
    random = np.random.default_rng(seed)
    everything: list[Outcome] = []
    print(f"{'fault':34s} {'trials':>6s} {'off':>4s} {'longest s':>9s} {'median s':>9s} {'states':>6s} {'lost':>4s}")
    for fault in faults:
        outcomes = []
        for _ in range(trials):
            outcomes.append(attempt(fault, float(random.uniform(0, 2.5)), patience))
            for line in outcomes[-1].wrong:
                print(f"{fault.name}: {line}", flush=True)
        everything += outcomes
        print(_row(fault.name, outcomes), flush=True)
    print(_row("all", everything))
    wrong = sum(bool(outcome.wrong or outcome.lost) for outcome in everything)
    print(f"trials with a fault: {wrong} of {len(everything)}")
    return wrong


def _row(name: str, outcomes: list[Outcome]) -> str:
    off = sum("the coil was left on" not in outcome.wrong for outcome in outcomes)
    on_for_s = [outcome.on_for_s for outcome in outcomes]
    states, lost = sum(o.acknowledged for o in outcomes), sum(o.lost for o in outcomes)
    return (
        f"{name:34s} {len(outcomes):6d} {off:4d} {max(on_for_s):9.2f} {np.median(on_for_s):9.2f} {states:6d} {lost:4d}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=5, help="trials of each fault")
    parser.add_argument("--fault", action="append", help="name of a fault; may be repeated")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments")
    parser.add_argument("--patience", type=float, default=1.0, help="factor on the promised times")
    parser.add_argument("--list", action="store_true", help="print the names of the faults")
    chosen = parser.parse_args()
    if chosen.list:
        print("\n".join(fault.name for fault in FAULTS))
        return
    by_name = {fault.name: fault for fault in FAULTS}
    if unknown := set(chosen.fault or []) - by_name.keys():
        parser.error(f"there is no {', '.join(unknown)}; see --list")
    faults = [by_name[name] for name in chosen.fault] if chosen.fault else list(FAULTS)
    sys.exit(1 if campaign(faults, chosen.trials, chosen.seed, chosen.patience) else 0)


if __name__ == "__main__":
    main()
