"""Symmetric band matrices of a whole batch: assembly by gathering, one LAPACK call for all candidates.

The candidates are blocks of one long band matrix. They do not couple, so the factorisation of one never reads
another's entries, and no loop over candidates is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class BandAssembly:
    """Where each entry of the element matrices goes in the lower band.

    dofs: (E, d) global number of each local unknown, -1 where it is fixed; n: number of unknowns.
    """

    def __init__(self, dofs: Indices, n: int) -> None:
        self.n = n
        d = dofs.shape[1]
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        keep = (rows >= columns) & (columns >= 0)
        self.bandwidth = int((rows - columns)[keep].max())
        source = np.flatnonzero(keep.ravel())  # index into (E, d, d)
        target = columns.ravel()[source] * (self.bandwidth + 1) + (rows - columns).ravel()[source]
        order = np.argsort(target, kind="stable")
        source, target = source[order], target[order]
        first = np.r_[True, target[1:] != target[:-1]]
        run = np.arange(len(target)) - np.flatnonzero(first)[np.cumsum(first) - 1]
        # Layer k holds the k-th contribution to each entry: up to four where four elements meet.
        self._layers = [(source[run == k], target[run == k]) for k in range(run.max() + 1)]
        self._block = d * d
        self._vector_dofs = dofs
        self._cache: dict[int, list[tuple[Indices, Indices]]] = {}

    def _indices(self, batch: int) -> list[tuple[Indices, Indices]]:
        if batch not in self._cache:
            if len(self._cache) > 32:
                self._cache.clear()
            shift = np.arange(batch, dtype=np.intp)[:, None]
            size = self.n * (self.bandwidth + 1)
            self._cache[batch] = [
                (
                    ((source // self._block) * (batch * self._block) + source % self._block + shift * self._block),
                    (target + shift * size),
                )
                for source, target in self._layers
            ]
        return self._cache[batch]

    def matrix(self, element_matrices: Array) -> Array:
        """Element matrices (E, B, d, d) -> lower band (B, n, bandwidth + 1)."""
        batch = element_matrices.shape[1]
        flat = element_matrices.ravel()
        band = np.zeros(batch * self.n * (self.bandwidth + 1))
        for k, (source, target) in enumerate(self._indices(batch)):
            if k == 0:
                band[target.ravel()] = flat[source.ravel()]
            else:
                band[target.ravel()] += flat[source.ravel()]
        return band.reshape(batch, self.n, self.bandwidth + 1)

    def vector(self, element_vectors: Array) -> Array:
        """Element vectors (E, B, d) -> (B, n)."""
        batch = element_vectors.shape[1]
        dofs = np.where(self._vector_dofs < 0, self.n, self._vector_dofs)
        index = dofs[:, None, :] + (np.arange(batch) * (self.n + 1))[None, :, None]
        total = np.bincount(index.ravel(), element_vectors.ravel(), minlength=batch * (self.n + 1)).astype(float)
        return total.reshape(batch, self.n + 1)[:, : self.n]


def solve(band: Array, right: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Solve every block: lower bands (B, n, w) and right-hand sides (B, n) -> solutions (B, n), ok (B,).

    Cholesky first; where a block is not positive definite (far from equilibrium), LU with pivoting serves the whole
    batch. Blocks with entries that are not finite are replaced by the identity, so that they spoil no neighbour.
    """
    batch, n, width = band.shape
    ok = np.isfinite(band).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
    if not ok.all():
        band, right = band.copy(), right.copy()
        band[~ok] = 0.0
        band[~ok, :, 0] = 1.0
        right[~ok] = 0.0
    matrix = band.reshape(batch * n, width).T
    _, x, info = lapack.dpbsv(matrix, right.reshape(-1), lower=1)
    if info != 0:
        x, singular = _solve_indefinite(band, right)
        ok = ok & ~singular
    x = x.reshape(batch, n)
    ok = ok & np.isfinite(x).all(axis=1)
    return np.where(ok[:, None], x, 0.0), ok


def _solve_indefinite(band: Array, right: Array) -> tuple[Array, NDArray[np.bool_]]:
    batch, n, width = band.shape
    k = width - 1
    lower = band.reshape(batch * n, width)
    full = np.zeros((3 * k + 1, batch * n), order="F")
    for r in range(width):  # rows of the band, a fixed small number
        full[2 * k + r] = lower[:, r]
        if r:
            full[2 * k - r, r:] = lower[:-r, r]
    _, _, x, info = lapack.dgbsv(k, k, full, right.reshape(-1), overwrite_ab=1)
    singular = np.zeros(batch, bool)
    if info > 0:  # an exactly zero pivot: find which candidate, answer for the others
        singular[(info - 1) // n] = True
        band, right = band.copy(), right.copy()
        band[singular] = 0.0
        band[singular, :, 0] = 1.0
        right[singular] = 0.0
        x, more = _solve_indefinite(band, right)
        singular |= more
    return x, singular
