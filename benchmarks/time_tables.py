"""Compute tables of frequencies for viscoelastic fits once, and share them between many simulated measurements."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from eimi_fitting import Loads
from eimi_fitting.time import identification
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import RingingBeam
from eimi_fitting.time.slow_evidence import LoadHistory, StaticEvidence

TABLE_STEP = 0.1  # of the logarithm of the moduli of the tables

_KEPT: dict[Any, Any] = {}


def once(key: Any, compute: Callable[[], Any]) -> Any:
    """Return the result of a computation, kept for later calls with the same key."""
    if key not in _KEPT:
        _KEPT[key] = compute()
    return _KEPT[key]


class KeptTable(RingTable):
    """The frequencies of a beam for a range of moduli, which several fits share."""

    def effects(self, sources: Any) -> Any:
        if not hasattr(self, "_effects"):
            self._effects = RingTable.effects(self, sources)
        return self._effects


@contextmanager
def tables_shared(store: Path) -> Iterator[None]:
    """Let fits in the `with` block share computed frequencies and other slow results, kept in the file `store`."""
    _KEPT.update(pickle.loads(store.read_bytes()) if store.exists() else {})
    loaded = len(_KEPT)

    def rounded(modulus_Pa: float) -> float:
        return float(np.exp(TABLE_STEP * round(np.log(modulus_Pa) / TABLE_STEP)))

    def of_loads(loads: Loads) -> bytes:
        return bytes(loads.field_T.tobytes() + loads.tip_force_N.tobytes())

    def table(beam: RingingBeam, middle_Pa: float) -> RingTable:
        middle = rounded(middle_Pa)
        return once(("table", of_loads(beam.loads), middle), lambda: KeptTable(beam, middle))

    modulus_at, histories = RingingBeam.modulus_at, LoadHistory.of
    undamped = RingingBeam.undamped_Hz
    static_effects = StaticEvidence.effects
    in_pictures = identification.modulus_in_pictures
    displacements, shown = identification.displacement_per_rad, identification.shown_rotations

    def modulus(beam: RingingBeam, frequency_Hz: float) -> float:
        near_Hz = float(np.exp(0.01 * round(100 * np.log(frequency_Hz))))  # it only chooses the table
        return once(("modulus", of_loads(beam.loads), near_Hz), lambda: modulus_at(beam, near_Hz))

    def undamped_Hz(beam: RingingBeam, modulus_Pa: float, count: int = 3) -> Any:
        key = ("undamped", of_loads(beam.loads), beam.specimen, modulus_Pa, count)
        return once(key, lambda: undamped(beam, modulus_Pa, count))

    def effects_of_static(static: StaticEvidence, sources: Any) -> Any:
        middle = rounded(static.modulus_Pa)
        near = replace(static, modulus_Pa=middle)
        return once(("static", middle, tuple(sources.items())), lambda: static_effects(near, sources))

    class Histories(LoadHistory):
        @staticmethod
        def of(beam: RingingBeam, middle_Pa: float, loads: Loads, begins_s: Sequence[float]) -> LoadHistory:
            middle = rounded(middle_Pa)
            key = ("history", of_loads(loads), middle, tuple(np.round(begins_s, 6)))
            return once(key, lambda: histories(beam, middle, loads, begins_s))

    def seen(beam: RingingBeam, modulus_Pa: float, motion: Motion) -> float:
        return rounded(in_pictures(beam, modulus_Pa, motion))

    def displacement(beam: RingingBeam, modulus: float, loads: Loads, before: Loads, rest: np.ndarray) -> Any:
        key = ("displacement", of_loads(loads), of_loads(before), modulus)
        return once(key, lambda: displacements(beam, modulus, loads, before, rest))

    def rotations(beam: RingingBeam, modulus: float, *others: Any) -> Any:
        return once(("shown", of_loads(beam.loads), modulus), lambda: shown(beam, modulus, *others))

    with (
        patch.object(RingingBeam, "modulus_at", modulus),
        patch.object(RingingBeam, "undamped_Hz", undamped_Hz),
        patch.object(StaticEvidence, "effects", effects_of_static),
        patch.object(identification, "RingTable", table),
        patch.object(identification, "LoadHistory", Histories),
        patch.object(identification, "modulus_in_pictures", seen),
        patch.object(identification, "displacement_per_rad", displacement),
        patch.object(identification, "shown_rotations", rotations),
    ):
        yield
    if len(_KEPT) > loaded:
        store.write_bytes(pickle.dumps(_KEPT))
