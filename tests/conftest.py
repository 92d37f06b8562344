"""Fixtures that every room of the tests shares."""

from __future__ import annotations

from pathlib import Path

import pytest

REAL_BEAM = Path(__file__).parents[2] / "shared" / "data" / "real_beam"


@pytest.fixture
def real_beam() -> Path:
    """The folder with the tracked points of a real beam; it lies beside the checkout and is no part of it."""
    if not REAL_BEAM.is_dir():
        pytest.skip(f"needs {REAL_BEAM}, which is not part of the repository")
    return REAL_BEAM
