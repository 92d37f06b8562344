"""Let every beam model return quick shapes instead of a simulation."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.model import BeamModel
from tests.shared.quick_beam import quick_shapes, quick_solid


@pytest.fixture(scope="module", autouse=True)
def quick_beams() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BeamModel, "solve", quick_shapes)
        patch.setattr(SolidBeside, "solve", quick_solid)
        yield
