"""Simulate measurements of beam edges, for fits that do not know the true material."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Section, Specimen
from eimi_fitting.inference.doubts.twisted_picture import tip_twist_per_tilt, without_twist
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.study.extent import Extent
from eimi_lab.study.hidden_materials import MATERIALS, HiddenMaterial

Array = NDArray[np.float64]

NOISE_MM = 4e-4  # 0.01 px at 25 px/mm: the RMS error of edges in the nominal picture, see docs/why/edges.md
TWISTED, TWIST_DEG = "type4", 1.0  # assumed rotation (degrees) of the tip about its axis in the strongest field
COIL_mT_PER_A = 4.7
# Elements along and across, and additional elements in each part of the depth. The solid of a fit has 20, 2 to 4 and 0.
_MESH = (26, 3, 1)
_AT_ENDS = 4  # points of an edge that are not measured at the clamp; half as many at the tip


def field_mT(material: HiddenMaterial, extent: Extent) -> Array:
    """Return the fields (mT) in which specimens of a material are measured, one for each state."""
    fields = np.array(load_protocol(material.protocol).currents_A) * COIL_mT_PER_A
    return fields[extent.chosen(len(fields))]


def specimen_of(kind: str) -> Specimen:
    """Return a beam of this project (`type1` to `type4`: four sizes, see protocols/specimens), with a solid section."""
    return replace(load_specimen(kind).mechanics(), section="solid")


def outlines_mm(
    material: HiddenMaterial, specimen: Specimen, fields: Array, bulk_modulus_Pa: float | None = None
) -> Array:
    """Simulate the left and right edges of a specimen without noise.

    Parameters
    ----------
    material : HiddenMaterial
        Material of the specimen.
    specimen : Specimen
        Beam and magnet.
    fields : ndarray, shape (K,)
        Fields of K states in mT.
    bulk_modulus_Pa : float, optional
        Bulk modulus; by default the material is incompressible.

    Returns
    -------
    ndarray, shape (K, 2, n, 2)
        Edges in mm; axes state, left and right edge, point, x and y.

    Raises
    ------
    ArithmeticError
        If the beam has no equilibrium in a state.
    """
    model = SolidBeside(specimen, *_MESH)
    bulk = None if bulk_modulus_Pa is None else np.array([bulk_modulus_Pa])
    shapes = model.solve(
        material.law, material.parameters, Loads.along(fields), tolerance_mm=1e-3, bulk_modulus_Pa=bulk
    )
    if not shapes.converged.all():
        raise ArithmeticError(f"the beam of {material.name} has no equilibrium in one of the fields")
    return points_on(outline(model, shapes)[0], 2)[:, :, _AT_ENDS : -_AT_ENDS // 2]


def measured_edges_mm(key: str, kind: str, extent: Extent) -> Array:
    """Return the edges (mm) of a specimen with simulated noise; axes state, left and right edge, point, x and y.

    `key` is the material, and `kind` the type of specimen.
    """
    material, specimen = MATERIALS[key], specimen_of(kind)
    fields = field_mT(material, extent)
    edges = outlines_mm(material, specimen, fields)
    if kind == TWISTED:
        edges = twisted(edges, material, fields)
    return edges + noise_mm(edges.shape, f"{key} {kind}")


def noise_mm(shape: tuple[int, ...], of: str, sigma_mm: float = NOISE_MM) -> Array:
    """Return normally distributed errors of edge points (mm); the text `of` is the seed."""
    return np.random.default_rng(zlib.crc32(of.encode())).normal(0.0, sigma_mm, shape)


def twisted(edges: Array, material: HiddenMaterial, fields: Array) -> Array:
    """Return the edges of a beam after the field has twisted it about its axis.

    Parameters
    ----------
    edges : ndarray, shape (K, 2, n, 2)
        Edges without twist in mm; axes state, left and right edge, point, x and y.
    material : HiddenMaterial
        Material of the beam.
    fields : ndarray, shape (K,)
        Fields of the K states in mT.

    Returns
    -------
    ndarray, shape (K, 2, n, 2)
        Edges with twist in mm.

    Raises
    ------
    ArithmeticError
        If the beam has no equilibrium in a state.
    """
    # Di Lecce et al. 2022 report that their specimen of type 4 turned about its own axis. The moment of its magnet is
    # tilted out of the plane of the picture. The beam models of the fits do not include this twist.
    straight = experiment_of(TWISTED, edges, fields, "solid")
    per_tilt = tip_twist_per_tilt(straight, material.law, material.parameters)
    if per_tilt is None:
        raise ArithmeticError(f"the beam of {material.name} has no equilibrium in one of the fields")
    angle_deg = TWIST_DEG / float(np.abs(per_tilt[np.argmax(fields)]))
    turned = without_twist(straight, straight, material.law, material.parameters, -angle_deg).observed
    assert isinstance(turned, EdgeObservation)
    return turned.points_mm


def experiment_of(kind: str, edges: Array, fields: Array, section: Section) -> Experiment:
    """Return the data of a fit to one specimen: beam model, loads and edges.

    `edges` holds mm, with the axes state, left and right edge, point, x and y. `fields` holds mT.
    """
    specimen = replace(specimen_of(kind), section=section)
    sigma = np.full(edges.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in edges])
    return Experiment(BeamModel(specimen, plane=specimen.planar_section).refined(), Loads.along(fields), observed)
