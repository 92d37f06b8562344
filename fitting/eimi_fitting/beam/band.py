"""Solve many linear systems with band matrices at once: assembly, and factorisation by LAPACK."""

# Each set of parameters of a law has its own system. The matrices are the diagonal blocks of one long band matrix.

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
_Layer = tuple[NDArray[np.integer], NDArray[np.integer], bool]


def bandwidth(dofs: Indices) -> int:
    """Return the largest distance of nonzero entries of the assembled stiffness matrix from its main diagonal."""
    # ``dofs`` (E, d): indices of the d unknowns of each of E elements; -1 for a fixed unknown.
    return int((dofs.max(axis=1) - np.where(dofs < 0, dofs.max(), dofs).min(axis=1)).max())


def _most_contributions(earlier: Indices) -> int:
    """Return the largest number of elements that contribute to one entry of the assembled matrix."""
    return int(earlier.max(initial=0)) + 1


class BandAssembly:
    """The assembly of element matrices into the band matrix of the whole mesh."""

    def __init__(self, dofs: Indices, n: int, at_once: int | None = None) -> None:
        # ``dofs`` (E, d): indices of the d unknowns of each of E elements; -1 for a fixed unknown. ``n``: number of
        # unknowns of the mesh. ``at_once``: number of elements whose matrices are in memory at a time; None: all
        # elements.
        self.n = n
        elements, d = dofs.shape
        size = at_once or elements
        self.parts = [slice(first, first + size) for first in range(0, elements, size)]
        self.bandwidth = bandwidth(dofs)
        self._block = d * d
        # For each group of elements, layers (source, target, new): add entry `source` of the element matrices to entry
        # `target` of the band. No target occurs twice in a layer. `new`: no earlier layer or group has these targets.
        self._layers: list[list[_Layer]] = []
        reached = np.zeros(n * (self.bandwidth + 1), bool)
        for part in self.parts:
            rows, columns = np.broadcast_arrays(dofs[part, :, None], dofs[part, None, :])
            source = np.flatnonzero((rows >= columns) & (columns >= 0))  # index into (elements of the part, d, d)
            row, column = rows.ravel()[source], columns.ravel()[source]
            target = column * (self.bandwidth + 1) + row - column
            order = np.argsort(target, kind="stable")
            source, target = source[order], target[order]
            first = np.r_[True, target[1:] != target[:-1]][: len(target)]
            run = np.arange(len(target)) - np.flatnonzero(first)[np.cumsum(first) - 1]
            fresh = (run == 0) & ~reached[target]
            reached[target] = True
            # Layer k holds the k-th contribution to each entry: up to four where four elements meet.
            most = _most_contributions(run)
            chosen = [(fresh, True), ((run == 0) & ~fresh, False), *((run == k, False) for k in range(1, most))]
            self._layers.append(
                [(source[c].astype(np.int32), target[c].astype(np.int32), new) for c, new in chosen if c.any()]
            )
        free = np.flatnonzero(dofs.ravel() >= 0)
        self._sum = scipy.sparse.csr_array((np.ones(len(free)), (dofs.ravel()[free], free)), shape=(n, dofs.size))
        self._cache: dict[int, list[list[_Layer]]] = {}

    def _indices(self, batch: int) -> list[list[_Layer]]:
        if batch == 1:  # a solid's indices are large, and a copy of them would have the same values
            return self._layers
        if (indices := self._cache.get(batch)) is None:
            if len(self._cache) > 32:
                self._cache.clear()
            shift = np.arange(batch, dtype=np.intp)[:, None]
            size, d2 = self.n * (self.bandwidth + 1), self._block
            indices = self._cache[batch] = [
                [
                    (
                        (source + source // d2 * ((batch - 1) * d2) + shift * d2).ravel(),
                        (target + shift * size).ravel(),
                        new,
                    )
                    for source, target, new in ((s.astype(np.intp), t, new) for s, t, new in layers)
                ]
                for layers in self._layers
            ]
        return indices

    def divided(self, element_matrices: Array) -> Iterator[Array]:
        """Divide the element matrices into the groups in which they are assembled."""
        # (E, B, d, d) for E elements and B systems.
        return (element_matrices[part] for part in self.parts)

    def matrix(self, parts: Iterable[Array]) -> Array:
        """Assemble the lower band of each system matrix from groups of element matrices."""
        # Each group is (e, B, d, d), and the result is (B, n, bandwidth + 1).
        band = np.zeros(0)
        for k, matrices in enumerate(parts):
            batch = matrices.shape[1]
            if k == 0:
                band = np.zeros(batch * self.n * (self.bandwidth + 1))
            flat = matrices.ravel()
            for source, target, new in self._indices(batch)[k]:
                if new:
                    band[target] = flat[source]
                else:
                    band[target] += flat[source]
        return band.reshape(-1, self.n, self.bandwidth + 1)

    def vector(self, element_vectors: Array) -> Array:
        """Assemble the vector of the whole mesh from the vectors of its elements."""
        # (E, B, d) gives (B, n).
        elements, batch, d = element_vectors.shape
        total = self._sum @ element_vectors.transpose(0, 2, 1).reshape(elements * d, batch)
        return np.ascontiguousarray(total.T)


@dataclass(frozen=True)
class BandFactor:
    """The Cholesky or LU factors of many band matrices."""

    # (B,): whether each matrix could be factorised.
    sound: NDArray[np.bool_]
    # (B,): whether each matrix is symmetric and not positive definite.
    indefinite: NDArray[np.bool_]
    # Cholesky factors in LAPACK's storage.
    cholesky: Array | None
    # LU factors and pivots in LAPACK's storage.
    lu: tuple[Array, Indices] | None
    # Number of diagonals below the main diagonal.
    bandwidth: int

    def solve(self, right: Array) -> Array:
        """Solve the linear systems for one or several right-hand sides."""
        # (B, n) or (m, B, n), as the result. The solution is zero for a matrix that could not be factorised.
        right = np.where(self.sound[:, None], right, 0.0)
        if self.cholesky is None:
            return self._by_lu(right)
        x, _ = scipy.linalg.lapack.dpbtrs(self.cholesky, _columns(right), lower=1)
        solutions = np.asarray(x.T.reshape(right.shape))
        if self.lu:
            solutions[..., self.indefinite, :] = self._by_lu(right[..., self.indefinite, :])
        return solutions

    def _by_lu(self, right: Array) -> Array:
        assert self.lu
        x, _ = scipy.linalg.lapack.dgbtrs(self.lu[0], self.bandwidth, self.bandwidth, _columns(right), self.lu[1])
        return np.asarray(x.T.reshape(right.shape))


def _columns(right: Array) -> Array:
    return right.reshape(-1, right.shape[-2] * right.shape[-1]).T


def factorise(
    band: Array, sound: NDArray[np.bool_], upper: Array | None = None, only_definite: bool = False
) -> BandFactor:
    """Factorise band matrices: positive definite matrices by Cholesky's method, other matrices by LU with pivoting."""
    # ``band`` (B, n, w): lower bands of B matrices with n rows and w diagonals.
    # ``sound`` (B,): true for the matrices that are factorised.
    # ``upper`` (B, n, w): lower bands of the transposed matrices; None if the matrices are symmetric.
    # ``only_definite``: mark symmetric matrices that are not positive definite as not sound. The factors then overwrite
    # ``band``.
    sound = sound & bounded(band)
    band, k = _with_identity(band, sound), band.shape[-1] - 1
    if upper is not None:
        lu, sound = _general_factors(band, upper, sound)
        return BandFactor(sound, np.zeros(len(band), bool), None, lu, k)
    batch, n, width = band.shape
    cholesky, info = scipy.linalg.lapack.dpbtrf(band.reshape(batch * n, width).T, lower=1, overwrite_ab=only_definite)
    indefinite = np.zeros(batch, bool)
    if info == 0:
        return BandFactor(sound, indefinite, cholesky, None, k)
    behind = 0  # number of blocks that are done, with factors or without
    while info:
        failed = behind + (info - 1) // n
        indefinite[failed], behind = True, failed + 1
        cholesky[:, failed * n : behind * n] = 0.0
        cholesky[0, failed * n : behind * n] = 1.0
        if behind == batch:
            break
        # The blocks after the one that failed are unchanged: the factorisation goes on with them, in place.
        _, info = scipy.linalg.lapack.dpbtrf(cholesky[:, behind * n :], lower=1, overwrite_ab=1)
    if only_definite:
        return BandFactor(sound & ~indefinite, indefinite, cholesky, None, k)
    others = band[indefinite]
    lu, rest_sound = _general_factors(others, others, np.ones(len(others), bool))
    sound = sound.copy()
    sound[indefinite] = rest_sound
    return BandFactor(sound, indefinite, cholesky, lu, k)


def _general_factors(
    lower: Array, upper: Array, sound: NDArray[np.bool_]
) -> tuple[tuple[Array, Indices], NDArray[np.bool_]]:
    """Return the LU factors and pivots of band matrices, and whether each matrix could be factorised."""
    n, width = lower.shape[1:]
    while True:
        full = _general(_with_identity(lower, sound), _with_identity(upper, sound))
        lu, pivots, info = scipy.linalg.lapack.dgbtrf(full, width - 1, width - 1, overwrite_ab=1)
        if info == 0:
            return (lu, pivots), sound
        # An exactly zero pivot: find which candidate it belongs to and go on without it.
        sound = sound & (np.arange(len(lower)) != (info - 1) // n)


def bounded(values: Array) -> NDArray[np.bool_]:
    """Return whether the sum of squares is finite in each row of an array."""
    if np.isfinite(np.vdot(values, values)):
        return np.ones(len(values), bool)
    flat = values.reshape(len(values), -1)
    return np.isfinite(np.einsum("bn,bn->b", flat, flat))


def _with_identity(band: Array, sound: NDArray[np.bool_]) -> Array:
    if sound.all():
        return band
    identity = np.zeros(band.shape[-1])
    identity[0] = 1.0
    return np.where(sound[:, None, None], band, identity)


def _general(lower: Array, upper: Array) -> Array:
    """Store band matrices as one matrix in LAPACK's format."""
    # B matrices with n rows and w diagonals give (3 w - 2, B n).
    batch, n, width = lower.shape
    k = width - 1
    below, above = lower.reshape(batch * n, width), upper.reshape(batch * n, width)
    full = np.zeros((3 * k + 1, batch * n), order="F")
    for r in range(width):  # rows of the band, a fixed small number
        full[2 * k + r] = below[:, r]
        if r:
            full[2 * k - r, r:] = above[:-r, r]
    return full
