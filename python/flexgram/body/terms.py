"""Terms of a body beside K and M: a matrix, and the law by which it counts at a frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError, check_name
from flexgram.body.laws import (
    Circulatory,
    Law,
    Loss,
    Prony,
    Table,
    Viscous,
    circulatory,
    prony,
    table,
)
from flexgram.body.varying_laws import (
    OF_PRODUCT,
    PRODUCT,
    SPEED,
    Coriolis,
    Parameter,
    Product,
    Spin,
    coriolis,
    parameter,
    product,
    spin,
)


@dataclass(frozen=True)
class Term:
    """g(ω)T beside K and M.

    Attributes
    ----------
    name : str
    law : Law
    matrix : (m, m) array, or sparse
        T, symmetric, positive semidefinite but of ``Spin``; skew of ``Coriolis`` and
        ``Circulatory``.
    """

    name: str
    law: Law
    matrix: Any = field(repr=False)

    def with_matrix(self, matrix: Any) -> Term:
        """The same law of another matrix."""
        return Term(self.name, self.law, matrix)


def _firsts(numbers: Sequence[Any]) -> list[float]:
    return [float(np.asarray(number).ravel()[0]) for number in numbers]


def _spin_of(*numbers: Any) -> Spin:
    least, most, value, power = _firsts(numbers)
    return spin(least, most, value, power=int(power))


def _parameter_of(*numbers: Any) -> Parameter:
    """Of what a file holds, in the order of its fields."""
    least, most, value, slope, loss, eta, beta = _firsts(numbers)
    return replace(parameter(least, most, value, slope=slope, loss=loss), eta=eta, beta=beta)


def _product_of(kind: str, numbers: Mapping[str, Any]) -> Product:
    least, most, value, slope = _firsts([numbers[name] for name in OF_PRODUCT])
    if kind == Viscous.kind:
        factor: Law = Viscous()
    elif kind == Loss.kind:
        factor = Loss(1.0)
    else:
        factor = law_of(kind, numbers, "factor")
    return product(parameter(least, most, value, slope=slope), factor)


def law_of(kind: str, numbers: Mapping[str, Any], where: str) -> Law:
    """The law that a file's attributes give.

    Raises
    ------
    BodyError
        Naming ``where``, for a kind that is none, or numbers that make no law.
    """
    known: dict[str, tuple[type[Law], Any]] = {
        "prony": (Prony, prony),
        "table": (Table, table),
        "parameter": (Parameter, _parameter_of),
        "spin": (Spin, _spin_of),
        "coriolis": (Coriolis, lambda *numbers: coriolis(*_firsts(numbers))),
        "circulatory": (Circulatory, circulatory),
    }
    if kind not in known and not kind.startswith(PRODUCT):
        raise BodyError(f"{where}: law {kind} must be one of {', '.join(known)}")
    try:
        if kind.startswith(PRODUCT):
            return _product_of(kind.removeprefix(PRODUCT), numbers)
        made, make = known[kind]
        law: Law = make(*(numbers[entry.name] for entry in fields(made)))
    except KeyError as error:
        raise BodyError(f"{where}: law {kind} needs {error}") from None
    except BodyError as error:
        raise BodyError(f"{where}: {error}") from None
    return law


def split_stiffness(
    K: Any, S: Any = None, eta: float = 0.0, where: str = "K"
) -> tuple[Any, Any, float]:
    """A complex K as a real one: its imaginary part is added to S, or to ``eta`` if it is a
    multiple of the real part. What is real, or is no SciPy matrix or array, stays as it is.

    Raises
    ------
    BodyError
        Naming ``where``, if the imaginary part is not symmetric, or gives energy.
    """
    if hasattr(K, "handle") or not np.iscomplexobj(K):
        return K, S, eta
    whole = sp.csr_matrix(K)
    real, imaginary = (  # with arrays of their own: parts of SciPy's share them
        sp.csr_matrix((part.copy(), whole.indices.copy(), whole.indptr.copy()), shape=whole.shape)
        for part in (whole.data.real, whole.data.imag)
    )
    largest = abs(imaginary).max()
    if largest == 0:
        return real, S, eta
    if abs(imaginary - imaginary.T).max() > 1e-12 * largest:
        raise BodyError(f"{where} is complex, and its imaginary part is not symmetric")
    if real.diagonal().sum() < 0:
        raise BodyError(
            f"{where} is negative (its diagonal sums up to {real.diagonal().sum():.3g}): flexgram "
            "takes M, D and K of Mq'' + Dq' + Kq = f; change the signs"
        )
    if imaginary.diagonal().sum() < 0:
        raise BodyError(
            f"{where} is complex, and its imaginary part is negative, as for motions exp(-iωt); "
            "hand over its conjugate"
        )
    factor = float(imaginary.multiply(real).sum() / real.multiply(real).sum())
    if factor > 0 and abs(imaginary - factor * real).max() <= 1e-12 * largest:
        return real, S, eta + factor
    imaginary.eliminate_zeros()
    return real, imaginary if S is None else S + imaginary, eta


def with_terms(
    D: Any, S: Any, terms: Mapping[str, tuple[Any, Law]] | None
) -> tuple[Any, Any, list[Term]]:
    """D and S with the terms that are theirs, and the others.

    Raises
    ------
    BodyError
        For what is no pair of a matrix and a law.
    """
    others = []
    for name, given in (terms or {}).items():
        if not (isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], Law)):
            raise BodyError(
                f"term {name}: expected (matrix, law), a law being flexgram.loss(eta), viscous(), "
                "prony(g, tau), table(omega, storage, loss), parameter(least, most), "
                "product(parameter, law), spin(least, most), coriolis(least, most) or circulatory()"
            )
        matrix, law = given
        if isinstance(law, Viscous):
            D = matrix if D is None else D + matrix
        elif isinstance(law, Loss):
            S = law.eta * matrix if S is None else S + law.eta * matrix
        else:
            of_speed = isinstance(law, (Parameter, Product)) and law.parameter(name) == SPEED
            if of_speed and not (isinstance(law, Product) and isinstance(law.factor, Circulatory)):
                raise BodyError(f"term {name}: that is the parameter of bodies that spin")
            others.append(Term(check_name("term", str(name)), law, matrix))
    return D, S, others
