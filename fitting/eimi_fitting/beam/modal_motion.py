"""The small vibrations of a beam as sums of a few given modes: frequencies and complex rates."""

# A vibration v exp(s t) with the shape v and the complex rate s satisfies (r(s) K_m + K_g + s² M) v = 0. K_m is the
# stiffness due to the tangent of the law, K_g the stiffness due to stresses and loads, M the mass matrix, and r the
# complex modulus divided by the static modulus.

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_ROOT_STEPS = 100
_DEPENDENT = 1e-10  # shapes whose mass is smaller than this share of the largest are sums of others
_IMMOBILE = 1e18  # 1/s²


@dataclass(frozen=True)
class ReducedMotion:
    """The stiffness and mass matrices of a beam that moves as a sum of a few given modes."""

    # m modes, for B candidate laws.

    # `material`, `rest`, `mass` (B, m, m): the stiffness due to the tangent of the law, the stiffness due to stresses
    # and loads (N/mm), and the mass (N s²/mm).
    material: Array
    rest: Array
    mass: Array
    # (m, B, N, d): displacements of N nodes with d coordinates in mm.
    nodal: Array
    # (m, B, 3): translation of the magnet in mm, and its rotation in rad.
    rigid: Array
    # (B,): whether the equilibrium is stable.
    sound: NDArray[np.bool_]

    def frequencies_Hz(self, count: int = 3) -> Array:
        """Return the lowest undamped frequencies of all candidate laws in Hz."""
        # (B, count).
        square = squares_by_stiffening(self.material, self.rest, self.mass, np.ones(1), count)[:, 0]
        return np.asarray(np.sqrt(np.maximum(square, 0.0)) / (2 * np.pi))

    def roots(self, modulus_ratio: Callable[[ComplexArray], ComplexArray], count: int = 3) -> ComplexArray:
        """Return the complex rates s of the lowest damped vibrations exp(s t) of all candidate laws."""
        # ``modulus_ratio``: complex modulus divided by static modulus, as a function of s. The result is (B, count) in
        # 1/s, NaN for a mode that does not vibrate.
        return complex_roots(self.material, self.rest, self.mass, modulus_ratio, count)

    def take(self, rows: NDArray[np.intp]) -> ReducedMotion:
        """Return the matrices of some of the candidate laws only."""
        return ReducedMotion(
            self.material[rows], self.rest[rows], self.mass[rows], self.nodal[:, rows], self.rigid[:, rows],
            self.sound[rows],
        )  # fmt: skip


def complex_roots(
    material: Array, rest: Array, mass: Array, modulus_ratio: Callable[[ComplexArray], ComplexArray], count: int = 3
) -> ComplexArray:
    """Compute the complex rates of damped vibrations from stiffness matrices, mass matrix and complex modulus."""
    # The rates s solve det(r(s) K_m + K_g + s² M) = 0.
    # ``material``, ``rest``, ``mass`` (B, m, m): K_m, K_g and M of B candidate laws: the stiffness due to the tangent
    # of the law, the stiffness due to stresses and loads, and the mass.
    # ``modulus_ratio``: the function r(s): the complex modulus divided by the static modulus.
    # ``count``: number of modes; at most m are returned.
    # The result (B, count): the rates in 1/s; NaN for a mode that does not vibrate.
    count = min(count, material.shape[-1])
    of_material, of_rest = (part[:, None] for part in _in_unit_mass(material, rest, mass))
    modes = np.arange(count)

    def squared_frequencies(stiffening: ComplexArray) -> ComplexArray:
        values = np.linalg.eigvals(stiffening[..., None, None] * of_material + of_rest)
        return np.asarray(np.sort_complex(values)[:, modes, modes])

    return fixed_point(squared_frequencies, modulus_ratio, (len(material), count))


def fixed_point(
    squared_frequencies: Callable[[ComplexArray], ComplexArray],
    modulus_ratio: Callable[[ComplexArray], ComplexArray],
    size: tuple[int, int],
) -> ComplexArray:
    """Solve s² = -squared_frequencies(modulus_ratio(s)) for the complex rates s of damped vibrations exp(s t)."""
    # ``squared_frequencies``: function of a ratio r: squared angular frequencies without damping for r times the static
    # modulus, (B, count).
    # ``modulus_ratio``: function of s: the complex modulus divided by the static modulus.
    # ``size``: the number B of candidate laws, and the number of modes (count).
    # The result (B, count): the rates in 1/s; NaN if the iteration does not converge, or if the mode does not vibrate.

    def next_root(s: ComplexArray) -> ComplexArray:
        return np.asarray(1j * np.sqrt(squared_frequencies(modulus_ratio(s))))

    with np.errstate(all="ignore"):
        s: ComplexArray = 1j * np.sqrt(squared_frequencies(np.ones(size, complex)))
        for _ in range(_ROOT_STEPS):
            first = next_root(s)
            second = next_root(first)
            bend = second - 2 * first + s
            # Aitken's method accelerates the convergence.
            s_next = np.where(np.abs(bend) > 1e-14 * np.abs(s), s - (first - s) ** 2 / bend, second)
            done = np.asarray(np.abs(s_next - s) <= 1e-12 * np.abs(s_next))
            s = s_next
            if np.all(done | ~np.isfinite(s)):
                break
    return np.where(done & (s.imag > 0), s, np.nan + 1j * np.nan)


def squares_by_stiffening(material: Array, rest: Array, mass: Array, stiffening: Array, count: int) -> Array:
    """Return the lowest squared angular frequencies for several ratios of the dynamic to the static modulus."""
    # ``material``, ``rest``, ``mass`` (B, m, m): the stiffness due to the tangent of the law, the stiffness due to
    # stresses and loads, and the mass. ``stiffening`` (q,): the ratios. The result is (B, q, count) in 1/s².
    of_material, of_rest = (part[:, None] for part in _in_unit_mass(material, rest, mass))
    return np.asarray(np.linalg.eigvalsh(stiffening[:, None, None] * of_material + of_rest)[..., :count])


def _in_unit_mass(material: Array, rest: Array, mass: Array) -> tuple[Array, Array]:
    """Transform two stiffness matrices to coordinates in which the mass matrix is the identity."""
    # ``material``, ``rest``, ``mass`` (B, m, m): K_m, K_g (see the module) and the mass matrix.
    sound = np.isfinite((material + rest + mass).sum(axis=(1, 2)))[:, None, None]
    mass = np.where(sound, mass, np.eye(mass.shape[-1]))
    material, rest = (np.where(sound, part, 0.0) for part in (material, rest))
    scale = 1 / np.sqrt(np.einsum("bmm->bm", mass))
    values, vectors = np.linalg.eigh(mass * scale[:, :, None] * scale[:, None, :])
    kept = values > _DEPENDENT * values[:, -1:]
    half = scale[:, :, None] * vectors * np.where(kept, 1 / np.sqrt(np.where(kept, values, 1.0)), 0.0)[:, None]
    of_material, of_rest = (half.swapaxes(-1, -2) @ part @ half for part in (material, rest))
    return of_material, of_rest + np.where(kept, 0.0, _IMMOBILE)[:, :, None] * np.eye(mass.shape[-1])
