"""Geometric stiffening of a floating frame in EXUDYN, which has no terms of its own for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexgram.basics import Floats

TRANSLATION = ["frame.ax", "frame.ay", "frame.az"]
ROTATION = ["frame.alphax", "frame.alphay", "frame.alphaz"]
#: ω_a² and ω_aω_b of these axes
SPINS = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]


def frame_stiffening(stiffening: dict[str, Floats]) -> dict[str, Floats]:
    """``stiffening`` (12, n, n) of the frame's motion: three accelerations, three angular ones, and
    ``SPINS``; nothing if there is none."""
    if not stiffening:
        return {}
    spins = [f"frame.spin{'xyz'[a]}{'xyz'[b]}" for a, b in SPINS]
    return {"stiffening": np.array([stiffening[load] for load in TRANSLATION + ROTATION + spins])}


class GeometricStiffening:
    """Kinetic energy of the second-order displacement of a body in its floating frame.

    Where its coordinates are q, points of the body move by φ q and, to second order, by what
    shortens it as it bends. The work of the frame's inertia forces on the latter is
    -½ qᵀ K_σ q (the stress under these forces, by virtual work), so its kinetic energy is

        T = v·c_t + ω·c_r - ½ Σ ω_aω_b qᵀK_ab q + v·(ω × s),
        c_t = q'ᵀK_t q, c_r = q'ᵀK_r q, s = ½ qᵀK_t q,

    v, ω of the frame in its axes. Its equations of motion hold the terms of Wallrapp's SID with
    geometric stiffening (K0t, K0r, K0ω: first-order parts of C_t, C_r, O_e) and the forces that
    answer them in the frame's own equations: energy and momentum are kept. Gravity g has the
    energy -g·s.

    Parameters
    ----------
    stiffening : (12, n, n) array
        As ``frame_stiffening`` has them.
    """

    def __init__(self, stiffening: Floats) -> None:
        self.K_t, self.K_r, self.K_spin = np.split(np.asarray(stiffening, float), [3, 6])

    def _inertia_of_spin(self, x: Floats, y: Floats) -> Floats:
        """Symmetric W with ωᵀWω = Σ ω_aω_b xᵀK_ab y."""
        W = np.zeros((3, 3))
        for (a, b), value in zip(SPINS, self.K_spin @ y @ x, strict=True):
            W[a, b] += value / 2
            W[b, a] += value / 2
        return W

    def mass(self, q: Floats) -> Floats:
        """(6 + n, 6 + n), by the acceleration of the frame, the angular one and q''."""
        n = len(q)
        of_t, of_r = self.K_t @ q, self.K_r @ q
        s = of_t @ q / 2
        skew = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
        M = np.zeros((6 + n, 6 + n))
        M[:3, 3:6], M[3:6, :3] = -skew, skew
        M[3:6, 3:6] = -self._inertia_of_spin(q, q)
        M[:3, 6:], M[6:, :3] = of_t, of_t.T
        M[3:6, 6:], M[6:, 3:6] = of_r, of_r.T
        return M

    def forces(self, omega: Floats, q: Floats, rate: Floats) -> Floats:
        """(6 + n,) of the velocities: what stands beside ``mass`` times the accelerations.

        Parameters
        ----------
        omega : (3,) array
            Of the frame, in its axes.
        q, rate : (n,) arrays
        """
        s = self.K_t @ q @ q / 2
        c_t, c_r = self.K_t @ q @ rate, self.K_r @ q @ rate
        W = self._inertia_of_spin(q, q)
        f_t = self.K_t @ rate @ rate + 2 * np.cross(omega, c_t)
        f_t += np.cross(omega, np.cross(omega, s))
        f_r = self.K_r @ rate @ rate - 2 * self._inertia_of_spin(q, rate) @ omega
        f_r += np.cross(omega, c_r - W @ omega)
        products = [omega[a] * omega[b] for a, b in SPINS]
        return np.concatenate([f_t, f_r, np.tensordot(products, self.K_spin, 1) @ q])

    def add(
        self, mbs: Any, rigid_node: Any, modal_node: Any, gravity: Any = (0.0, 0.0, 0.0)
    ) -> Any:
        """Add it to a body of these nodes, the first of Euler parameters.

        Parameters
        ----------
        gravity : 3 numbers
            In inertial axes [m/s²].

        Returns
        -------
        The number of the object.
        """
        import exudyn.itemInterface as eii
        import exudyn.rigidBodyUtilities

        parameters: Any = exudyn.rigidBodyUtilities
        start = np.asarray(mbs.GetNode(rigid_node)["referenceCoordinates"])[3:7]
        n = self.K_t.shape[1]

        def motion(q: Any) -> tuple[Floats, Floats]:
            """From the nodes' rates to v, ω and q', (6 + n, 7 + n), and q."""
            q = np.asarray(q)
            angles = start + q[3:7]
            Z = np.zeros((6 + n, 7 + n))
            Z[:3, :3] = np.asarray(parameters.EulerParameters2RotationMatrix(angles)).T
            Z[3:6, 3:7] = parameters.EulerParameters2GLocal(angles)
            Z[6:, 7:] = np.eye(n)
            return Z, q[7:]

        def mass(_mbs: Any, _t: float, _item: int, q: Any, _rate: Any) -> Any:
            Z, own = motion(q)
            return Z.T @ self.mass(own) @ Z

        def force(_mbs: Any, _t: float, _item: int, q: Any, rate: Any) -> Any:
            Z, own = motion(q)
            rates = Z @ np.asarray(rate)
            weight = self.mass(own)[:, :3] @ (Z[:3, :3] @ np.asarray(gravity, float))
            return Z.T @ (weight - self.forces(rates[3:6], own, rates[6:]))

        functions: dict[str, Any] = {
            "massMatrixUserFunction": mass,
            "forceUserFunction": force,
        }
        return mbs.AddObject(
            eii.ObjectGenericODE2(
                nodeNumbers=[rigid_node, modal_node],
                **functions,
                visualization=eii.VObjectGenericODE2(show=False),
            )
        )
