"""The outlines of the hidden solids as edges: what a camera and an edge finder would have made of them.

The outline of the solid itself, on a mesh finer than a fit's, with normal noise of the edge finder's size. Nothing is
rendered: the edge finder adds a hundredth of a pixel to a clean picture, and rendering costs most of the time.

Type 4 is turned about its own axis, as the paper's was: in proportion to field and distance from the clamp. The camera
then sees some of its depth beside its width. No planar model, nor the solid of a fit, knows of that.
"""

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
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.study.extent import Extent
from eimi_lab.study.hidden_materials import MATERIALS, HiddenMaterial

Array = NDArray[np.float64]

NOISE_MM = 4e-4  # 0.01 px at 25 px/mm: what fits of the virtual rig's pictures leave, see fitting/README.md
TWISTED, TWIST_DEG = "type4", 1.0  # at the tip in the strongest field
COIL_mT_PER_A = 4.7
_MESH = (26, 3, 1)  # elements along and across, and times as many in depth; a fit's solid has 20, 2 and 1
_AT_ENDS = 4  # points of an edge beside the clamp, and half as many at the tip, that are not seen


def field_mT(material: HiddenMaterial, extent: Extent) -> Array:
    """(K,): of the states that are measured."""
    every = np.array(load_protocol(material.protocol).currents_A) * COIL_mT_PER_A
    return every[extent.chosen(len(every))]


def specimen_of(kind: str) -> Specimen:
    """A shipped specimen, as the solid that it is."""
    return replace(load_specimen(kind).mechanics(), section="solid")


def outlines_mm(
    material: HiddenMaterial, specimen: Specimen, fields: Array, bulk_modulus_Pa: float | None = None
) -> Array:
    """(K, 2, n, 2): left and right edges of the hidden solid, without noise. Raises ArithmeticError."""
    model = SolidBeside(specimen, *_MESH)
    bulk = None if bulk_modulus_Pa is None else np.array([bulk_modulus_Pa])
    shapes = model.solve(
        material.law, material.parameters, Loads.along(fields), tolerance_mm=1e-3, bulk_modulus_Pa=bulk
    )
    if not shapes.converged.all():
        raise ArithmeticError(f"a specimen of {material.name} finds no equilibrium")
    return points_on(outline(model, shapes)[0], 2)[:, :, _AT_ENDS : -_AT_ENDS // 2]


def seen_edges_mm(key: str, kind: str, extent: Extent) -> Array:
    """(K, 2, n, 2): edges of a specimen of the material of this key, with noise and, for one type, twist."""
    material, specimen = MATERIALS[key], specimen_of(kind)
    fields = field_mT(material, extent)
    edges = outlines_mm(material, specimen, fields)
    if kind == TWISTED:
        edges = twisted(edges, specimen, np.radians(TWIST_DEG) * fields / fields.max())
    return edges + noise_mm(edges.shape, f"{key} {kind}")


def noise_mm(shape: tuple[int, ...], of: str, sigma_mm: float = NOISE_MM) -> Array:
    """Of one specimen, the same whenever it is asked for."""
    return np.random.default_rng(zlib.crc32(of.encode())).normal(0.0, sigma_mm, shape)


def twisted(edges: Array, specimen: Specimen, at_tip_rad: Array) -> Array:
    """Edges (K, 2, n, 2) of a beam that is turned about its axis, linearly up to (K,) at the tip.

    A section of width w and depth d that is turned by t is w cos t + d sin t wide to the camera.
    """
    angle = at_tip_rad[:, None, None] * np.linspace(0.0, 1.0, edges.shape[2])
    wider = 0.5 * (specimen.width_mm * (np.cos(angle) - 1) + specimen.depth_mm * np.abs(np.sin(angle)))
    along = np.gradient(edges, axis=2)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    to_left = np.stack([along[..., 1], -along[..., 0]], axis=-1)  # the left edge has y < 0
    outward = np.array([1.0, -1.0])[None, :, None, None] * to_left
    return np.asarray(edges + wider[..., None] * outward)


def experiment_of(kind: str, edges: Array, fields: Array, section: Section) -> Experiment:
    """What a fit gets: edges (K, 2, n, 2), loads and the specimen under a section; nothing of the material."""
    specimen = replace(specimen_of(kind), section=section)
    sigma = np.full(edges.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in edges])
    return Experiment(BeamModel(specimen, plane=specimen.planar_section).refined(), Loads.along(fields), observed)
