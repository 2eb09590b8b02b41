"""The error of a reduced body as a form: what is known of it beyond its norm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexgram.basics import ComplexArray, Floats


@dataclass
class PortForm:
    """Of some ports.

    Attributes
    ----------
    modal : (N, ports) array
        In modal coordinates.
    residual : (k, ports) array
        What the medium model leaves of them.
    lost : (ports,) array
        Norms of what the k rows do not hold.
    rounding : (N, ports) array
        Of each entry of ``modal``.
    """

    modal: Floats
    residual: Floats
    lost: Floats
    rounding: Floats


@dataclass
class ErrorForm:
    """The group ``/form`` of a reduced file: the error of a body beyond its norm.

    With x_j = inputs_j / (a_k stiffness_j + a_m mass_j), a_k = 1 + i (η + ω β), a_m = i ω α - ω²,
    the medium model is H_m = outputsᵀ x, and H = H_m + W_Cᵀ S⁻¹ W_B with the residuals
    W = residual - (a_k - κ a_m) residual_stiffness x (docs/proof.md, sections 2, 3 and 8).

    Attributes
    ----------
    stiffness, mass : (N,) arrays
        Of its modes, of which stiffness + τ mass = 1 for some τ.
    inputs, outputs : PortForm
    residual_stiffness : (k, N) array
    lost_stiffness : (N,) array
        Norms of what the k rows do not hold.
    coupling : (modes,) array
        What the modes below the cutoff leave of their own equation.
    rounding_stiffness, rounding_mass : (N,) arrays
        Sums of the rows of what rounding does to the modal matrices.
    alpha, beta, eta, kappa, cutoff : float
        Damping [1/s, s, 1], κ [s²], ω_c [rad/s].
    """

    stiffness: Floats
    mass: Floats
    inputs: PortForm
    outputs: PortForm
    residual_stiffness: Floats
    lost_stiffness: Floats
    coupling: Floats
    rounding_stiffness: Floats
    rounding_mass: Floats
    alpha: float
    beta: float
    eta: float
    kappa: float
    cutoff: float

    def medium_response(self, omega: float) -> ComplexArray:
        """H_m at a frequency [rad/s], (outputs, inputs)."""
        a_k = 1 + 1j * (self.eta + omega * self.beta)
        a_m = 1j * omega * self.alpha - omega**2
        denominator: ComplexArray = a_k * self.stiffness + a_m * self.mass
        response: ComplexArray = (self.outputs.modal.T / denominator) @ self.inputs.modal
        return response

    @classmethod
    def of(cls, found: dict[str, Any]) -> ErrorForm | None:
        """From the fields of a reduced body; None if it has no form."""
        if "form/stiffness" not in found:
            return None

        def array(name: str) -> Floats:
            return np.asarray(found[f"form/{name}"], dtype=np.float64)

        def number(name: str) -> float:
            return float(found[f"form/{name}"])

        def ports(name: str) -> PortForm:
            kept = ("residual", "lost", "rounding")
            return PortForm(array(name), *(array(f"{kind}_{name}") for kind in kept))

        return cls(
            stiffness=array("stiffness"),
            mass=array("mass"),
            inputs=ports("inputs"),
            outputs=ports("outputs"),
            residual_stiffness=array("residual_stiffness"),
            lost_stiffness=array("lost_stiffness"),
            coupling=array("coupling"),
            rounding_stiffness=array("rounding_stiffness"),
            rounding_mass=array("rounding_mass"),
            alpha=number("alpha"),
            beta=number("beta"),
            eta=number("eta"),
            kappa=number("kappa"),
            cutoff=number("cutoff"),
        )
