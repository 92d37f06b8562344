"""Model a beam with a magnet at the tip in FElupe, another finite element program (github.com/adtzlr/felupe).

This module adds the rigid magnet, which has three unknowns: two translations and a rotation. The equations are solved
by Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import felupe
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from eimi_fitting.beam.mesh import graded, grid_mesh
from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Specimen

Array = NDArray[np.float64]

# Bulk modulus divided by shear modulus. With 5000, elements of eight nodes take more iterations and are not more exact.
BULK_RATIO = {"bilinear": 5000.0, "serendipity": 1000.0}
_MOST_ITERATIONS, _MOST_HALVINGS = 30, 4


@dataclass(frozen=True)
class Elements:
    """The finite elements of a mesh in FElupe.

    Attributes
    ----------
    kind : {"bilinear", "serendipity"}
        Four nodes and mean dilatation, or eight nodes and 2 x 2 Gauss points.
    along, across : int
        Numbers of elements along and across the beam.
    graded : bool
        Whether the elements are finer near the clamp and the magnet.
    """

    kind: str
    along: int
    across: int
    graded: bool

    @property
    def text(self) -> str:
        """Return the description of the elements for a table."""
        return f"{self.kind} {self.along} x {self.across}, {'graded' if self.graded else 'equal'}"


@dataclass(frozen=True)
class Curve:
    """Tip positions (x, y) in K fields (mm), shape (K, 2), and the total number of Newton iterations."""

    tip: Array
    iterations: int


class NoEquilibrium(Exception):
    """Newton's method finds no equilibrium of the beam in a field."""


def _points(elements: Elements, length: float, width: float) -> tuple[Array, NDArray[np.intp]]:
    """Return the N nodes of the mesh, mm, shape (N, 2), and the node numbers of each element in FElupe's order.

    `length` and `width` of the flexible part are in mm.
    """
    finer = (10.0, 5.0) if elements.graded else (0.0, 0.0)
    x = graded(length, elements.along, 0.5 * width, *finer)
    mesh = grid_mesh(x, np.linspace(-0.5 * width, 0.5 * width, elements.across + 1))
    corners_then_sides = [0, 6, 8, 2, 3, 7, 5, 1]
    local = corners_then_sides[:4] if elements.kind == "bilinear" else corners_then_sides
    used, cells = np.unique(mesh.elements[:, local], return_inverse=True)
    return mesh.nodes[used], cells.reshape(-1, len(local))


def _material(law: str, parameters: Array) -> tuple[Any, float]:
    """Return the deviatoric material of a law in FElupe (moduli in MPa), and the initial shear modulus (MPa)."""
    if law == "neo-hookean":
        return felupe.NeoHooke(mu=parameters[0]), float(parameters[0])
    if law == "ogden":  # FElupe's moduli are mu_p alpha_p / 2
        mu, alpha = 0.5 * parameters[0::2] * parameters[1::2], parameters[1::2]
        return felupe.Hyperelastic(felupe.ogden, mu=list(mu), alpha=list(alpha)), float(mu.sum())
    raise ValueError(f"{law} is not compared")


class Beam:
    """A beam with a magnet at the tip in FElupe, with gravity along the beam and the field (mT) across the beam."""

    def __init__(self, specimen: Specimen, elements: Elements, law: str, parameters_MPa: Array) -> None:
        magnet = specimen.magnet
        assert magnet is not None
        self.length = specimen.flexible_length_mm
        points, cells = _points(elements, self.length, specimen.width_mm)
        material, mu = _material(law, parameters_MPa)
        if elements.kind == "bilinear":
            self.region = felupe.RegionQuad(felupe.Mesh(points, cells, "quad"))
        else:
            mesh = felupe.Mesh(points, cells, "quad8")
            self.region = felupe.RegionQuadraticQuad(mesh, quadrature=felupe.GaussLegendre(order=1, dim=2))
        self.field = felupe.FieldContainer([felupe.FieldPlaneStrain(self.region, dim=2)])
        bulk = BULK_RATIO[elements.kind] * mu
        if elements.kind == "bilinear":
            self.body = felupe.SolidBodyNearlyIncompressible(material, self.field, bulk=bulk)
        elif law == "neo-hookean":
            self.body = felupe.SolidBody(felupe.NeoHooke(mu=mu, bulk=bulk), self.field)
        else:
            self.body = felupe.SolidBody(material & felupe.Volumetric(bulk=bulk), self.field)
        weight = felupe.SolidBodyForce(self.field, values=[1e-9 * specimen.density_kg_m3 * STANDARD_GRAVITY, 0.0])
        self.weight = weight.assemble.vector().toarray().ravel()
        block = magnet.length_mm * specimen.width_mm * specimen.depth_mm
        magnet_mm3 = magnet.length_mm * magnet.width_mm * magnet.depth_mm
        mass = (
            1e-9
            * (magnet_mm3 * magnet.density_kg_m3 + (block - magnet_mm3) * specimen.density_kg_m3)
            / specimen.depth_mm
        )
        self.magnet_weight = mass * STANDARD_GRAVITY
        self.magnet_length = magnet.length_mm
        self.moment = magnet.moment_A_m2 / specimen.depth_mm  # N mm per mm of depth and mT
        self.tied = np.flatnonzero(points[:, 0] > self.length - 1e-9)
        self.arms = points[self.tied] - [self.length, 0.0]
        free = np.setdiff1d(np.flatnonzero(points[:, 0] > 1e-9), self.tied)
        self.count, self.free = len(points), free
        dofs = (2 * free[:, None] + np.arange(2)).ravel()
        self.n = len(dofs)  # the translations and the rotation of the magnet come after these
        shape = (2 * self.count, self.n + 3)
        self.selection = sparse.csr_matrix((np.ones(self.n), (dofs, np.arange(self.n))), shape=shape)

    def _place(self, x: Array) -> Array:
        """Return the displacements of all N nodes in mm, (N, 2).

        ``x``: displacements of the free nodes (mm), then two translations (mm) and the rotation (rad) of the magnet.
        """
        displacement = np.zeros((self.count, 2))
        displacement[self.free] = x[: self.n].reshape(-1, 2)
        c, s = np.cos(x[-1]), np.sin(x[-1])
        displacement[self.tied] = x[-3:-1] + self.arms @ np.array([[c - 1, s], [-s, c - 1]])
        return displacement

    def _step(self, x: Array, field_mT: float) -> Array:
        """Return the change of the unknowns ``x`` in one Newton step."""
        self.field[0].values[:] = self._place(x)
        out_of_balance = self.weight - self.body.assemble.vector(self.field).toarray().ravel()
        stiffness = self.body.assemble.matrix()
        c, s = np.cos(x[-1]), np.sin(x[-1])
        slope = self.arms @ np.array([[-s, c], [-c, -s]])
        n, rows = self.n, 2 * self.tied
        turning = sparse.csr_matrix(
            (
                np.concatenate([np.ones(2 * len(rows)), slope[:, 0], slope[:, 1]]),
                (np.concatenate([rows, rows + 1] * 2), np.repeat([n, n + 1, n + 2, n + 2], len(rows))),
            ),
            shape=self.selection.shape,
        )
        tie = self.selection + turning
        right = tie.T @ out_of_balance
        right[-3] += self.magnet_weight
        lever = 0.5 * self.magnet_length * self.magnet_weight
        right[-1] += self.moment * field_mT * c - lever * s
        pull = out_of_balance.reshape(-1, 2)[self.tied]
        curvature = self.arms @ np.array([[-c, -s], [s, -c]])
        turning_stiffness = self.moment * field_mT * s + lever * c - np.sum(pull * curvature)
        added = sparse.csc_matrix(([turning_stiffness], ([n + 2], [n + 2])), shape=(n + 3, n + 3))
        return np.asarray(spsolve((tie.T @ stiffness @ tie).tocsc() + added, right))

    def _equilibrium(self, x: Array, field_mT: float, tolerance_mm: float) -> tuple[Array | None, int]:
        """Return the unknowns in equilibrium, or None without convergence, and the number of Newton iterations."""
        for iteration in range(_MOST_ITERATIONS):
            step = self._step(x, field_mT)
            largest = np.abs(step).max()
            if not largest < 10 * self.length:
                return None, iteration + 1
            x = x + step
            if largest < tolerance_mm:
                return x, iteration + 1
        return None, _MOST_ITERATIONS

    def curve(self, fields_mT: Array, tolerance_mm: float) -> Curve:
        """Return the tip positions in K fields, solved in the given order.

        A Newton iteration ends at a step below `tolerance_mm`. Raises NoEquilibrium.
        """
        x, before, spent, tips = np.zeros(self.n + 3), 0.0, 0, []
        for target in fields_mT:
            size = target - before
            now = before
            while True:
                checkpoint = self.body.checkpoint()
                solution, iterations = self._equilibrium(x, now + size, tolerance_mm)
                spent += iterations
                if solution is None:
                    self.body.restore(checkpoint)
                    size /= 2
                    if size < (target - before) / 2**_MOST_HALVINGS:
                        raise NoEquilibrium(f"at {now + size:g} mT")
                    continue
                x, now = solution, now + size
                if now >= target - 1e-12:
                    break
            before = target
            reach = self.length + x[-3] + self.magnet_length * np.cos(x[-1])
            tips.append([reach, x[-2] + self.magnet_length * np.sin(x[-1])])
        return Curve(np.array(tips), spent)
