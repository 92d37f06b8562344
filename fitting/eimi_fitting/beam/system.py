"""The linear system of a Newton step: the nodes, and the three unknowns of a rigid body (the magnet)."""

# With the unknowns x of the nodes and y of the body, K x + C y = f and R x + D y = g. If the rows of the body do not
# fit in the band matrix, y is computed from the Schur complement, (D - R K^-1 C) y = g - R K^-1 f.

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.band import BandAssembly, BandFactor, bandwidth, bounded, factorise
from eimi_fitting.beam.mesh import Indices

Array = NDArray[np.float64]
Sound = NDArray[np.bool_]

_LOWER = np.tril_indices(3)


class Solution(NamedTuple):
    """The solution of the linear systems of all candidate laws."""

    # (B, n): changes of the n unknown displacements of nodes, in mm.
    nodes: Array
    # (B, 3): changes of the magnet's translation (x, y) in mm and rotation in rad.
    body: Array
    # (B,): whether the system could be solved.
    sound: Sound
    # (B,): whether the matrix is symmetric and not positive definite.
    indefinite: Sound


class System:
    """The assembly and solution of the linear equations of a Newton step on a mesh."""

    def __init__(self, dofs: Indices, n: int, tied: Indices | None, at_once: int | None = None) -> None:
        # ``dofs`` (E, d): indices of the d unknowns of each of E elements; -1 if an unknown is fixed or belongs to the
        # magnet. ``n``: number of unknowns of the nodes. ``tied``: the elements with nodes on the magnet. ``at_once``:
        # number of elements whose matrices are in memory at a time; None: all elements.
        self.n = n
        self._tied = tied
        self._in_band = False
        if tied is not None:
            tied_dofs = dofs[tied].ravel()
            free = np.flatnonzero(tied_dofs >= 0)
            self._columns, place = np.unique(tied_dofs[free], return_inverse=True)
            self._gather = scipy.sparse.csr_array(
                (np.ones(len(free)), (place, free)), shape=(len(self._columns), tied_dofs.size)
            )
            self._in_band = n + 2 - int(self._columns[0]) <= bandwidth(dofs)
            if self._in_band:
                # Places in the lower band (n + 3, w): entry (i, j) stands at row j, column i - j.
                w = bandwidth(dofs) + 1
                rows = n + np.arange(3)[:, None]
                self._row_places = (self._columns * w + rows - self._columns).ravel()
                self._corner_places = (n + _LOWER[1]) * w + _LOWER[0] - _LOWER[1]
        self._assembly = BandAssembly(dofs, n + 3 if self._in_band else n, at_once)

    def assembled(self, force: Array) -> Array:
        """Assemble the forces on the mesh from the forces of its elements."""
        # (E, B, d) gives (B, n).
        return self._assembly.vector(force)[:, : self.n]

    def solve(
        self,
        stiffness: Array | Iterable[Array],
        force: Array,
        right: Array,
        body: tuple[Array, Array, Array] | None,
        sound: Sound,
        symmetric: bool,
        only_definite: bool = False,
    ) -> Solution:
        """Assemble the stiffness and the forces of the elements, and solve the linear systems of all candidate laws."""
        # K x = right - f with the stiffness K and the forces f.
        # ``stiffness`` (E, B, d, d): the matrices of E elements with d unknowns each, for B candidates, all together or
        # in the groups of `BandAssembly`.
        # ``force`` (E, B, d): forces of the elements.
        # ``right`` (B, n) or (1, n): right-hand side for the n unknowns of the nodes.
        # ``body``, for the rigid magnet: derivatives of the unknowns of the H elements at the magnet with respect to
        # its motion, (H, B, d, 3); its stiffness, (B, 3, 3); the loads on it, (B, 3) or (1, 3).
        # ``sound`` (B,): true for the candidates that are solved.
        # ``symmetric``: whether the stiffness is symmetric.
        # ``only_definite``: do not solve candidates whose symmetric matrix is not positive definite.
        rest = right - self.assembled(force)
        parts = self._assembly.divided(stiffness) if isinstance(stiffness, np.ndarray) else stiffness
        if not symmetric:
            parts = list(parts)  # they are read once more for the transpose
        tied_parts: list[Array] = []
        band = self._assembly.matrix(self._collecting(parts, tied_parts))
        if body is None:
            factor = self._factor(band, parts, None, sound & bounded(rest), symmetric, only_definite)
            return Solution(factor.solve(rest), np.zeros((len(rest), 3)), factor.sound, factor.indefinite)
        tie, further, pull = body
        tied_stiffness, follow = np.concatenate(tied_parts), tie.swapaxes(-1, -2)
        rows = np.matmul(follow, tied_stiffness)  # (H, B, 3, d)
        corner = np.matmul(rows, tie).sum(axis=0) + further
        pull = pull - np.matmul(follow, force[self._tied][..., None])[..., 0].sum(axis=0)
        both = np.concatenate([rest, pull], axis=1)
        sound = sound & bounded(both)
        rows = self._body_coupling(rows)
        columns = rows if symmetric else self._body_coupling(np.matmul(follow, tied_stiffness.swapaxes(-1, -2)))
        if self._in_band:
            band = self._with_body(band, rows, corner)
            factor = self._factor(band, parts, (columns, corner.swapaxes(-1, -2)), sound, symmetric, only_definite)
            step = factor.solve(both)
            return Solution(step[:, : self.n], step[:, self.n :], factor.sound, factor.indefinite)
        factor = self._factor(band, parts, None, sound, symmetric, only_definite)
        sides = np.zeros((4, *rest.shape))
        sides[0] = rest
        sides[1:, :, self._columns] = columns.transpose(1, 0, 2)
        steps = factor.solve(sides)
        reached = steps[:, :, self._columns].transpose(1, 2, 0)  # (B, m, 4)
        schur = np.concatenate([pull[..., None], corner], axis=2) - np.matmul(rows, reached)
        sound = factor.sound & np.isfinite(schur).all(axis=(1, 2))
        matrix = np.where(sound[:, None, None], schur[..., 1:], np.eye(3))
        determinant = np.linalg.det(matrix)
        # The whole matrix is positive definite if the matrix of the nodes and the Schur complement are positive
        # definite. The Schur complement is positive definite if its leading principal minors are positive
        # (Sylvester's criterion).
        minor = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
        positive = (matrix[:, 0, 0] > 0) & (minor > 0) & (determinant > 0)
        indefinite = factor.indefinite | ~positive if symmetric else factor.indefinite
        sound = sound & (determinant != 0)
        matrix = np.where(sound[:, None, None], matrix, np.eye(3))
        rigid = np.linalg.solve(matrix, schur[..., :1] * sound[:, None, None])[..., 0]
        nodes = steps[0] - np.einsum("rbn,br->bn", steps[1:], rigid)
        return Solution(nodes * sound[:, None], rigid, sound, indefinite)

    def _collecting(self, parts: Iterable[Array], tied: list[Array]) -> Iterator[Array]:
        # Pass the matrices of each group of elements on; append those of elements with nodes on the magnet to ``tied``.
        for part, matrices in zip(self._assembly.parts, parts, strict=True):
            if self._tied is not None:
                inside = self._tied[(self._tied >= part.start) & (self._tied < part.stop)]
                tied.append(matrices[inside - part.start])
            yield matrices

    def _body_coupling(self, rows: Array) -> Array:
        """Return the stiffness between the magnet and the nodes around it."""
        # ``rows`` (H, B, 3, d): the contributions of H elements with d unknowns. The result is (B, 3, m) for m unknowns
        # of the nodes.
        e, b, _, d = rows.shape
        total = self._gather @ rows.transpose(0, 3, 1, 2).reshape(e * d, b * 3)
        return np.ascontiguousarray(total.T).reshape(b, 3, -1)

    def _with_body(self, band: Array, rows: Array, corner: Array) -> Array:
        """Write the stiffness of the magnet into the lower band of the system matrix; return the band."""
        # ``rows`` (B, 3, m): stiffness between the magnet and m unknowns of nodes. ``corner`` (B, 3, 3): that of the
        # magnet.
        flat = band.reshape(len(band), -1)
        flat[:, self._row_places] = rows.reshape(len(rows), -1)
        flat[:, self._corner_places] = corner[:, _LOWER[0], _LOWER[1]]
        return band

    def _factor(
        self,
        lower: Array,
        parts: Iterable[Array],
        body: tuple[Array, Array] | None,
        sound: Sound,
        symmetric: bool,
        only_definite: bool,
    ) -> BandFactor:
        if symmetric:
            return factorise(lower, sound, only_definite=only_definite)
        upper = self._assembly.matrix(matrices.swapaxes(-1, -2) for matrices in parts)
        return factorise(lower, sound, self._with_body(upper, *body) if body else upper)


def structure_of(dofs: Indices, n: int, tied: Indices | None, at_once: int | None = None) -> System:
    """Return the object that assembles and solves the linear equations of a mesh."""
    # The arguments are those of `System`. Equal meshes share one object.
    if at_once is not None:
        return System(dofs, n, tied, at_once)
    return _shared_structure(dofs.tobytes(), dofs.shape, n, None if tied is None else tied.tobytes())


@lru_cache(maxsize=32)
def _shared_structure(dofs: bytes, shape: tuple[int, ...], n: int, tied: bytes | None) -> System:
    elements = None if tied is None else np.frombuffer(tied, np.intp)
    return System(np.frombuffer(dofs, np.intp).reshape(shape), n, elements)


class FactoredSystem:
    """The factorised linear systems of all candidate laws, which can be solved for many right-hand sides."""

    # ``sound`` (B,): whether the matrix is positive definite.

    def __init__(self, structure: System, stiffness: Array, body: tuple[Array, Array] | None) -> None:
        # ``stiffness`` (E, B, d, d): symmetric matrices of E elements with d unknowns each. ``body``: derivatives of
        # the unknowns of the H elements at the magnet with respect to its motion, (H, B, d, 3), and the stiffness of
        # the magnet due to loads, (B, 3, 3); None without a magnet.
        self._structure, self._body = structure, body
        batch = stiffness.shape[1]
        band = structure._assembly.matrix(structure._assembly.divided(stiffness))
        if body is not None:
            tie, further = body
            tied_stiffness, follow = stiffness[structure._tied], tie.swapaxes(-1, -2)
            rows = np.matmul(follow, tied_stiffness)
            corner = np.matmul(rows, tie).sum(axis=0) + further
            self._rows = structure._body_coupling(rows)
            if structure._in_band:
                band = structure._with_body(band, self._rows, corner)
        self._factor = factorise(band, np.ones(batch, bool))
        self.sound = self._factor.sound & ~self._factor.indefinite
        if body is not None and not structure._in_band:
            sides = np.zeros((3, batch, structure.n))
            sides[:, :, structure._columns] = self._rows.transpose(1, 0, 2)
            self._moved = self._factor.solve(sides)  # K^-1 C
            reached = self._moved[:, :, structure._columns].transpose(1, 2, 0)
            schur = corner - np.matmul(self._rows, reached)
            self.sound = self.sound & (np.linalg.eigvalsh(schur)[:, 0] > 0)
            self._schur = np.where(self.sound[:, None, None], schur, np.eye(3))

    def solve(self, nodes: Array, body: Array) -> tuple[Array, Array]:
        """Solve for the nodal displacements and the motion of the magnet (``body``), for several right-hand sides."""
        # ``nodes`` (m, B, n) and ``body`` (m, B, 3): the right-hand sides of the nodes and of the rigid magnet, as the
        # results.
        structure = self._structure
        if self._body is None:
            return self._factor.solve(nodes), np.zeros_like(body)
        if structure._in_band:
            both = self._factor.solve(np.concatenate([nodes, body], axis=2))
            return both[..., : structure.n], both[..., structure.n :]
        alone = self._factor.solve(nodes)
        rest = body - np.einsum("brc,mbc->mbr", self._rows, alone[:, :, structure._columns])
        rigid = np.linalg.solve(self._schur, rest[..., None])[..., 0]
        return alone - np.einsum("rbn,mbr->mbn", self._moved, rigid), rigid
