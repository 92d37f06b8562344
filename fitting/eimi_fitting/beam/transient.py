"""The motion of a planar beam in plane stress in time, with inertia and viscoelasticity.

Time is integrated by the generalised-alpha method with alpha_f = 0 (Chung and Hulbert 1993, J. Appl. Mech. 60:371). The
material is quasi-linear viscoelastic with a Prony series (Simo and Hughes 1998, Computational Inelasticity, section
10.3). Each time step is solved by Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam import element
from eimi_fitting.beam.element import Batch, Evaluation
from eimi_fitting.beam.equilibrium import SolidLoads
from eimi_fitting.beam.inertia import Inertia
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import Shapes, candidates
from eimi_fitting.beam.rigid import dead_moment
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

_SPECTRAL_RADIUS = 0.9  # factor on the amplitude of very high frequencies in each step
_TOLERANCE_MM = 1e-7
_MOST_ITERATIONS = 12
_MOST_PARTS = 64  # largest number of parts into which a step is divided


class NotSolved(Exception):
    """Newton's method did not converge in a time step."""


@dataclass
class _State:
    """The motion of the beam at one time: displacements, velocities, accelerations and stresses."""

    # Arrays of the N nodes have the shape (N, 2). Two point masses (``points``, (2, 2)) stand for the magnet.

    nodes: Array
    node_velocity: Array
    node_acceleration: Array
    rigid: Array
    rigid_velocity: Array
    points: Array
    point_velocity: Array
    point_acceleration: Array
    elastic: Array
    overstress: Array


class Transient:
    """The motion of a beam in time, under loads that change from time step to time step.

    The beam starts at rest in the equilibrium under ``loads``.

    Parameters
    ----------
    model : BeamModel
        The planar model of the beam, in plane stress.
    law : Law
        The instantaneous hyperelastic law.
    parameters : ndarray, shape (n,)
        The n parameters of the law; moduli in Pa.
    series : Prony
        One Prony series.
    loads : Loads
        The loads at the start, in one load state.

    Raises
    ------
    ValueError
        The beam model is not in plane stress.
    NotSolved
        The beam has no equilibrium under these loads.
    """

    def __init__(self, model: BeamModel, law: Law, parameters: Array, series: Prony, loads: Loads) -> None:
        if model.plane != "plane-stress":
            raise ValueError(
                f'the motion is computed in plane stress only: the model needs "plane-stress", not "{model.plane}"'
            )
        self.model, self.series, self._solid = model, series, model.solid
        self._inertia = Inertia(model)
        self._instantaneous = candidates(law, parameters[None], model.plane, None, None).batch
        self.time_s = 0.0
        is_modulus = np.array([unit == "Pa" for unit in law.units])
        long_term = np.where(is_modulus, float(series.long_term) * parameters, parameters)
        rest = model.solve(law, long_term[None], loads, tolerance_mm=_TOLERANCE_MM)
        if not rest.converged[0]:
            raise NotSolved("no equilibrium of the beam was found under the loads at the start of the motion")
        now = rest.last
        elastic = self._evaluated(self._instantaneous, now.displacement).S
        body = self._inertia
        radius = np.sqrt(body.body_rotary / body.body_mass) if body.body_mass else 0.0
        # Two points with half of the mass each have the rotary inertia of the body.
        self._arms = body.body_arm_mm + np.array([[radius, 0.0], [-radius, 0.0]])
        self._is_modulus = is_modulus
        zero = np.zeros_like(now.displacement[0])
        points = self._point_displacements(now.rigid[0])
        overstress = np.zeros((len(series.g), *elastic.shape))
        self._state = _State(
            nodes=now.displacement[0].copy(),
            node_velocity=zero,
            node_acceleration=zero.copy(),
            rigid=now.rigid[0].copy(),
            rigid_velocity=np.zeros(3),
            points=points,
            point_velocity=0 * points,
            point_acceleration=0 * points,
            elastic=elastic,
            overstress=overstress,
        )

    @property
    def rigid(self) -> Array:
        """Present translation (x, y) of the magnet in mm and its rotation in rad."""
        return self._state.rigid

    def shapes(self) -> Shapes:
        """Return the present shape of the beam."""
        # One candidate law in one load state.
        rest = self._solid.rest(1)
        now = replace(rest, displacement=self._state.nodes[None], rigid=self._state.rigid[None])
        one = np.ones((1, 1))
        return Shapes(
            now.displacement[:, None], now.rigid[:, None], np.zeros((1, 1), np.int8), one.astype(np.intp), one, now
        )

    def advance(self, step_s: float, loads: Loads, with_inertia: bool = True) -> None:
        """Advance the beam's motion by one time step.

        Parameters
        ----------
        step_s : float
            Length of the step in s.
        loads : Loads
            The loads at the end of the step, in one load state.
        with_inertia : bool
            False: neglect inertia, for slow creep.

        Raises
        ------
        NotSolved
            Newton's method does not converge.
        """
        parts = 1
        while parts <= _MOST_PARTS:
            before, time_s = self._state, self.time_s
            try:
                for _ in range(parts):
                    self._advance(step_s / parts, loads, with_inertia)
                return
            except NotSolved:
                self._state, self.time_s, parts = before, time_s, 2 * parts
        raise NotSolved(
            f"Newton's method does not converge between {self.time_s:.6g} s and {self.time_s + step_s:.6g} s, even in "
            f"{_MOST_PARTS} parts of this step"
        )

    def _advance(self, step_s: float, loads: Loads, with_inertia: bool) -> None:
        old = self._state
        # In a step, the internal variable of each term of the Prony series is multiplied by ``fading``. To it is added
        # the change of the elastic stress, multiplied by ``share``.
        fading = np.exp(-step_s / self.series.tau_s)
        share = self.series.g * -np.expm1(-step_s / self.series.tau_s) * self.series.tau_s / step_s
        stiffness = float(self.series.long_term + share.sum())
        batch = self._scaled(stiffness)
        remembered = np.tensordot(fading, old.overstress, 1) - share.sum() * old.elastic
        on_mesh = loads.on(self.model.loaded)(loads.state(0), np.ones(1))
        alpha_m = (_SPECTRAL_RADIUS - 1) / (_SPECTRAL_RADIUS + 1)
        beta, gamma = 0.25 * (1 - alpha_m) ** 2, 0.5 - alpha_m
        inertia = (1 - alpha_m) / (beta * step_s**2) if with_inertia else 0.0

        def accelerations(moved: Array, before: Array, velocity: Array, acceleration: Array) -> Array:
            new = (moved - before - step_s * velocity) / (beta * step_s**2) - (0.5 / beta - 1) * acceleration
            return np.asarray(new)

        nodes, rigid = old.nodes.copy(), old.rigid.copy()
        if with_inertia:
            nodes, rigid = nodes + step_s * old.node_velocity, rigid + step_s * old.rigid_velocity
            nodes = self._with_tied(nodes, rigid)
        for _ in range(_MOST_ITERATIONS):
            ev = self._evaluated(batch, nodes[None])
            of_nodes = accelerations(nodes, old.nodes, old.node_velocity, old.node_acceleration)
            of_points = accelerations(
                self._point_displacements(rigid), old.points, old.point_velocity, old.point_acceleration
            )
            pushed = (1 - alpha_m) * of_nodes + alpha_m * old.node_acceleration if with_inertia else 0 * of_nodes
            pulled = (1 - alpha_m) * of_points + alpha_m * old.point_acceleration if with_inertia else 0 * of_points
            moved_nodes, moved_rigid = self._newton(ev, remembered, on_mesh, pushed, pulled, inertia, rigid)
            new_nodes, new_rigid = nodes + moved_nodes, rigid + moved_rigid
            new_nodes = self._with_tied(new_nodes, new_rigid)
            largest = float(np.abs(new_nodes - nodes).max())
            nodes, rigid = new_nodes, new_rigid
            if not np.isfinite(largest):
                break
            if largest < _TOLERANCE_MM:
                self._settle(nodes, rigid, batch, stiffness, fading, share, step_s, gamma, accelerations, with_inertia)
                return
        raise NotSolved(f"Newton's method does not converge at {self.time_s + step_s:.6g} s")

    def _newton(
        self,
        ev: Evaluation,
        remembered: Array,
        loads: SolidLoads,
        node_accelerations: Array,
        point_accelerations: Array,
        inertia: float,
        rigid: Array,
    ) -> tuple[Array, Array]:
        """Compute one iteration of Newton's method; return the changes of the nodes and of the magnet's motion."""
        # ``remembered``: stress to add to that of ``ev``. ``node_accelerations`` (N, 2) and ``point_accelerations`` (2,
        # 2): of the nodes, and of two point masses that stand for the magnet. ``rigid`` (3,): motion of the magnet.
        solid, masses = self._solid, self._inertia.of_elements
        e = len(solid.mesh.elements)
        K = element.stiffness(solid.ops, ev, ev.S + remembered)
        force = ev.force + _force_of_stress(solid.ops, ev.F, remembered)
        force = force + np.matmul(solid.by_element(node_accelerations[None]), masses[:, None])
        blocks = K.reshape(e, 1, 2, 9, 2, 9)
        for direction in range(2):
            blocks[:, :, direction, :, direction] += inertia * masses[:, None]
        force = force.reshape(e, 1, 18)
        right = loads.nodal.reshape(len(loads.nodal), -1)[:, solid.free]
        body = None
        if solid.body:
            moment, turning = dead_moment(loads.tensor, rigid[None])
            half = 0.5 * self._inertia.body_mass
            turned, bent = self._point_arms(rigid, 1), self._point_arms(rigid, 2)
            pull = np.zeros((1, 3))
            pull[:, :2] = loads.force - half * point_accelerations.sum(axis=0)
            pull[:, 2] = moment + loads.moment - half * (turned * point_accelerations).sum()
            stiffness = inertia * self._inertia.of_body(rigid[2:3])
            stiffness[:, 2, 2] += turning + solid.body.stiffness_of_turning(force, rigid[None])
            stiffness[:, 2, 2] += half * (bent * point_accelerations).sum()
            body = solid.body.matrix(rigid[None]), stiffness, pull
        x, step, sound, _ = solid.system.solve(K, force, right, body, ev.valid, True)
        if not sound[0]:
            return np.full(solid.mesh.nodes.shape, np.nan), step[0]
        flat = np.zeros(solid.mesh.nodes.size)
        flat[solid.free] = x[0]
        return flat.reshape(solid.mesh.nodes.shape), step[0]

    def _settle(
        self,
        nodes: Array,
        rigid: Array,
        batch: Batch,
        stiffness: float,
        fading: Array,
        share: Array,
        step_s: float,
        gamma: float,
        accelerations: object,
        with_inertia: bool,
    ) -> None:
        """Compute velocities, accelerations and stresses at the end of a time step, and store them."""
        # ``nodes`` (N, 2) and ``rigid`` (3,): displacements of the nodes and of the magnet.
        old = self._state
        # The moduli of ``batch`` are those of the instantaneous law multiplied by ``stiffness``.
        elastic = self._evaluated(batch, nodes[None]).S / stiffness
        change = elastic - old.elastic
        overstress = np.multiply.outer(fading, np.ones(1))[:, :, None, None, None] * old.overstress
        overstress = overstress + np.multiply.outer(share, change)
        points = self._point_displacements(rigid)
        if with_inertia and callable(accelerations):
            of_nodes = accelerations(nodes, old.nodes, old.node_velocity, old.node_acceleration)
            of_points = accelerations(points, old.points, old.point_velocity, old.point_acceleration)
            v_nodes = old.node_velocity + step_s * ((1 - gamma) * old.node_acceleration + gamma * of_nodes)
            v_points = old.point_velocity + step_s * ((1 - gamma) * old.point_acceleration + gamma * of_points)
        else:
            of_nodes, v_nodes, of_points, v_points = 0 * nodes, 0 * nodes, 0 * points, 0 * points
        v_rigid = (rigid - old.rigid) / step_s if with_inertia else np.zeros(3)
        self._state = _State(nodes, v_nodes, of_nodes, rigid, v_rigid, points, v_points, of_points, elastic, overstress)
        self.time_s += step_s

    def _with_tied(self, nodes: Array, rigid: Array) -> Array:
        """Move the magnet's nodes rigidly with the magnet."""
        # ``nodes`` (N, 2): displacements in mm, as the result.
        carried = nodes[None].copy()
        if self._solid.body:
            self._solid.body.carry(carried, rigid[None])
        return np.asarray(carried[0])

    def _scaled(self, factor: float) -> Batch:
        parameters = np.where(self._is_modulus, factor * self._instantaneous.parameters, self._instantaneous.parameters)
        return replace(self._instantaneous, parameters=parameters)

    def _evaluated(self, batch: Batch, displacement: Array) -> Evaluation:
        nodal = self._solid.by_element(displacement)
        return element.evaluate(self._solid.ops, batch, nodal, np.zeros((len(nodal), 1, 3)))

    def _point_arms(self, rigid: Array, derivative: int) -> Array:
        """Return the vectors (x, y) from the magnet's reference point to two point masses in it."""
        # ``rigid`` (3,): motion of the magnet. ``derivative``: order of the derivative by the rotation. The result is
        # (2, 2) in mm.
        angle = rigid[2] + 0.5 * np.pi * derivative
        c, s = np.cos(angle), np.sin(angle)
        return self._arms @ np.array([[c, s], [-s, c]])

    def _point_displacements(self, rigid: Array) -> Array:
        """Return the displacements (x, y) of two point masses that stand for the magnet, in mm."""
        return np.asarray(rigid[:2] + self._point_arms(rigid, 0) - self._arms)


def _force_of_stress(ops: element.Operators, F: Array, stress: Array) -> Array:
    """Return the nodal forces of elements due to a stress at their Gauss points."""
    # ``F`` (2, 2, E, B, q): deformation gradient. ``stress``: (3, E, B, q). The result is (E, B, 2, 9).
    s11, s22, s12 = stress
    (f11, f12), (f21, f22) = F
    n, b = s11.shape[:2]
    P = np.empty((n, b, 2, 2, s11.shape[2]))
    P[:, :, 0, 0], P[:, :, 0, 1] = f11 * s11 + f12 * s12, f11 * s12 + f12 * s22
    P[:, :, 1, 0], P[:, :, 1, 1] = f21 * s11 + f22 * s12, f21 * s12 + f22 * s22
    return np.matmul(P.reshape(n, b * 2, -1), ops.weighted).reshape(n, b, 2, 9)
