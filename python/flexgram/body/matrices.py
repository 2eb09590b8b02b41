"""A body of matrices in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flexgram.body.laws import Law


@dataclass
class Matrices:
    """A body handed over in memory.

    Attributes
    ----------
    K, M, D : SciPy sparse or petsc4py Mat, n x n
        Stiffness [N/m], mass [kg], optional damping [N s/m]; symmetric, both triangles. A skew part
        of D is taken for gyroscopic forces, the imaginary part of K for structural damping. SciPy
        matrices are the same on every rank, each takes its rows; petsc4py matrices in AIJ are used
        as they are, without a copy, others are converted.
    B : array, n x n_in
        Inputs (n: one of them); with petsc4py matrices the rows that this rank owns.
    C : array, n_out x n, optional
        Outputs, default ``B.T``; with petsc4py the columns of the rows that this rank owns.
    alpha, beta, eta : float
        Rayleigh coefficients [1/s], [s], structural loss factor.
    S : SciPy sparse or petsc4py Mat, n x n, optional
        Structural damping, Σ η_k K_k of materials with loss factors η_k [N/m].
    terms : mapping, optional
        By name (T, law), T like K and a law of ``flexgram.loss``, ``viscous``, ``prony``,
        ``table``: A(ω) has g(ω)T in addition.
    inputs, outputs : sequence of str, optional
        Port names.
    node, component : int arrays, n, optional
        Label of each row's node (any number), and 0-2 for its translation, 3-5 for its rotation.
        Helps the ordering, and gives rigid modes and frame integrals.
    position : array, n x 3, optional
        Place of each row's node [m]. Like B by rows of this rank where the matrices are petsc4py's.
    name : str
        For messages.
    """

    K: Any
    M: Any
    B: Any
    D: Any = None
    C: Any = None
    alpha: float = 0.0
    beta: float = 0.0
    eta: float = 0.0
    inputs: Sequence[str] | None = None
    outputs: Sequence[str] | None = None
    node: Any = None
    component: Any = None
    position: Any = None
    name: str = "matrices"
    S: Any = None
    terms: Mapping[str, tuple[Any, Law]] | None = None
