"""Published moduli are found by the name of the silicone; a stress at 100 % strain becomes a shear modulus."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.reporting.published_moduli import PUBLISHED, published_moduli


@pytest.mark.parametrize("name", ["Dragon Skin 10", "dragon_skin_10", "Dragon Skin 10 Medium", "DRAGON-SKIN 10 NV"])
def test_a_silicone_is_recognised_in_other_spellings(name: str) -> None:
    assert {row.material for row in published_moduli(name)} == {"Dragon Skin 10"}


@pytest.mark.parametrize("name", ["", "Dragon Skin", "Ecoflex 00-100", "Ecoflex", "unknown"])
def test_another_silicone_has_no_value(name: str) -> None:
    assert published_moduli(name) == []


def test_a_stress_at_100_per_cent_strain_is_that_of_a_neo_hookean_material() -> None:
    # The technical bulletin of Dragon Skin 10 gives 22 psi, which is 151.7 kPa.
    row = next(row for row in PUBLISHED if row.material == "Dragon Skin 10" and "22 psi" in row.how)
    stress = engineering_stress(LAWS["neo-hookean"], np.array([row.low_Pa]), np.array([1.0]))
    assert float(np.squeeze(stress)) == pytest.approx(151.7e3, rel=1e-3)


def test_every_published_modulus_has_its_source() -> None:
    for row in PUBLISHED:
        assert row.source
        assert row.how
        assert 5e3 < row.low_Pa <= row.high_Pa < 2e6
