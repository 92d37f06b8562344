"""Published moduli of common silicones, for a comparison with the identified modulus."""

# Each modulus is a published number, or is computed from a published number as the field `how` explains. A data sheet
# gives the stress at 100 % strain, that is, at the stretch 2. It is converted to the shear modulus mu of the Neo-
# Hookean material that has the same stress at this stretch: stress = mu (2 - 1/2²). The result is a mean over large
# strains and not an initial modulus.

from __future__ import annotations

import re
from dataclasses import dataclass

_PA_PER_PSI = 6894.757  # NIST Special Publication 811 (2008), appendix B.8
_NEO_HOOKEAN_AT_100 = 2 - 1 / 4  # engineering stress over shear modulus at a stretch of 2


@dataclass(frozen=True)
class PublishedModulus:
    """A published shear modulus of a silicone.

    Attributes
    ----------
    material : str
        Name of the product.
    low_Pa, high_Pa : float
        The ends of the published range of the shear modulus, Pa; equal for a single value.
    how : str
        The published quantity, and how the shear modulus follows from this quantity.
    source : str
        The data sheet or the publication.
    """

    material: str
    low_Pa: float
    high_Pa: float
    how: str
    source: str


def _of_data_sheet(material: str, psi: float, series: str) -> PublishedModulus:
    modulus = psi * _PA_PER_PSI / _NEO_HOOKEAN_AT_100
    how = f"Neo-Hookean law with the stress of the data sheet at 100 % strain, {psi:g} psi"
    return PublishedModulus(material, modulus, modulus, how, f"Smooth-On, technical bulletin of the {series} series")


_DATABASE = "tensile curve of Marechal et al. 2020, doi:10.1089/soro.2019.0115"
_YEOH = "Yeoh law fitted by `eimi tensile` up to 100 % strain, 95 % interval"

PUBLISHED = (
    _of_data_sheet("Dragon Skin 10", 22, "Dragon Skin"),
    PublishedModulus("Dragon Skin 10", 39.65e3, 42.14e3, _YEOH, _DATABASE),
    _of_data_sheet("Dragon Skin 20", 49, "Dragon Skin"),
    _of_data_sheet("Dragon Skin 30", 86, "Dragon Skin"),
    _of_data_sheet("Ecoflex 00-10", 8, "Ecoflex"),
    _of_data_sheet("Ecoflex 00-20", 8, "Ecoflex"),
    _of_data_sheet("Ecoflex 00-30", 10, "Ecoflex"),
    _of_data_sheet("Ecoflex 00-50", 12, "Ecoflex"),
    PublishedModulus("Ecoflex 00-50", 18.27e3, 21.03e3, _YEOH, _DATABASE),
    PublishedModulus(
        "Sylgard 184",
        1.32e6 / 3,
        2.97e6 / 3,
        "Young's modulus 1.32 to 2.97 MPa after curing at 25 to 200 °C, divided by 3",
        "Johnston et al. 2014, doi:10.1088/0960-1317/24/3/035017",
    ),
)


def published_moduli(material: str) -> list[PublishedModulus]:
    """Return the published moduli of a silicone; empty for an unknown silicone.

    Examples
    --------
    >>> [row.source.split(",")[0] for row in published_moduli("dragon_skin_10 medium")]
    ['Smooth-On', 'tensile curve of Marechal et al. 2020']
    >>> published_moduli("Dragon Skin 100")
    []
    """
    words = _words(material)
    return [row for row in PUBLISHED if words[: len(_words(row.material))] == _words(row.material)]


def _words(material: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", material.lower())
