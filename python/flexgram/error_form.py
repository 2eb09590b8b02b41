"""The error of a reduced body as a form: what is known of it beyond its norm."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass
class ErrorForm:
    """The group ``/form`` of a reduced file: the error of a body beyond its norm.

    With x_j = inputs_j / (a_k stiffness_j + a_m mass_j), a_k = 1 + i (η + ω β), a_m = i ω α - ω²,
    the medium model is H_m = outputsᵀ x and the residual
    W_B = residual_inputs - (a_k - κ a_m) residual_stiffness x.

    Attributes
    ----------
    stiffness, mass : (N,) arrays
        Of its modes, of which stiffness + τ mass = 1 for some τ.
    inputs, outputs : (N, n_in) and (N, n_out) arrays
    residual_stiffness : (k, N) array
    residual_inputs, residual_outputs : (k, n_in) and (k, n_out) arrays
    lost_stiffness, lost_inputs, lost_outputs : (N,), (n_in,), (n_out,) arrays
        Norms of what the k rows do not hold.
    coupling : (modes,) array
        What the modes below the cutoff leave of their own equation.
    rounding_stiffness, rounding_mass : (N,) arrays
        Sums of the rows of what rounding does to the modal matrices.
    rounding_inputs, rounding_outputs : (N, n_in) and (N, n_out) arrays
    alpha, beta, eta, kappa, cutoff : float
        Damping [1/s, s, 1], κ [s²], ω_c [rad/s].
    """

    stiffness: Floats
    mass: Floats
    inputs: Floats
    outputs: Floats
    residual_stiffness: Floats
    residual_inputs: Floats
    residual_outputs: Floats
    lost_stiffness: Floats
    lost_inputs: Floats
    lost_outputs: Floats
    coupling: Floats
    rounding_stiffness: Floats
    rounding_mass: Floats
    rounding_inputs: Floats
    rounding_outputs: Floats
    alpha: float
    beta: float
    eta: float
    kappa: float
    cutoff: float

    @classmethod
    def of(cls, found: dict[str, Any]) -> ErrorForm | None:
        """From the fields of a reduced body; None if it has no form."""
        if "form/stiffness" not in found:
            return None
        values: dict[str, Any] = {}
        for field in fields(cls):
            value = found.get(f"form/{field.name}", np.empty(0))
            is_number = field.name in ("alpha", "beta", "eta", "kappa", "cutoff")
            values[field.name] = float(value) if is_number else np.asarray(value, dtype=np.float64)
        return cls(**values)
