"""Laws that depend on a number known between two others: parameters and speeds."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats
from flexgram.body.laws import Circulatory, Law, Loss, Prony, Table, Viscous

#: The parameter of bodies that spin, [rad/s].
SPEED = "speed"
#: What stands before the kind of the other law in that of a product; its own numbers.
PRODUCT = "parameter*"
OF_PRODUCT = ("least", "most", "value", "slope")


@dataclass(frozen=True)
class Varying(Law):
    """A law that depends on a parameter of the body.

    Attributes
    ----------
    least, most, value : float
        The parameter is between the first two; what it is at present. In its own unit.
    """

    least: float
    most: float
    value: float

    def parameter(self, term: str) -> str:
        """The name of the parameter, of a term of that name."""
        return term

    def with_value(self, value: float, name: str) -> Self:
        """With another value of the parameter ``name``.

        Raises
        ------
        BodyError
            For one that is not between least and most.
        """
        if not self.least <= value <= self.most:
            raise BodyError(
                f"{name} = {value:g}: the body knows {name} from {self.least:g} to {self.most:g}"
            )
        return replace(self, value=float(value))

    def numbers(self) -> dict[str, Floats]:
        return {entry.name: np.array([getattr(self, entry.name)]) for entry in fields(self)}


@dataclass(frozen=True)
class Spin(Varying):
    """Ω^power - least^power: what a spin adds to the stiffness, seen in the frame that turns. K
    holds it at the least speed; T is it at 1 rad/s.

    Attributes
    ----------
    power : int
        2: stress and softening. 4: moved geometry, at second order.
    """

    power: int = 2
    kind = "spin"

    def parameter(self, term: str) -> str:
        return SPEED

    @property
    def words(self) -> str:
        return f"stiffness of spin, from {self.least:g} to {self.most:g} rad/s"

    @property
    def stiffness(self) -> float:
        """Of T, beside K."""
        squares = (self.value - self.least) * (self.value + self.least)
        return squares * (self.value**2 + self.least**2) if self.power == 4 else squares

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = np.full(np.shape(omega), self.stiffness, dtype=np.complex128)
        return g


@dataclass(frozen=True)
class Coriolis(Varying):
    """iωΩ of a skew matrix T: gyroscopic forces at 1 rad/s."""

    kind = "coriolis"

    def parameter(self, term: str) -> str:
        return SPEED

    @property
    def words(self) -> str:
        return f"gyroscopic forces of spin, from {self.least:g} to {self.most:g} rad/s"

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = 1j * self.value * np.asarray(omega, dtype=float)
        return g


@dataclass(frozen=True)
class Parameter(Varying):
    """(p - least) slope (1 + i(loss + eta) + iω beta): a stiffness that is known between two
    numbers, p at present.

    Attributes
    ----------
    least, most, value : float
        K holds the stiffness at the least.
    slope : float
        Of the stiffness, in T over the unit of the parameter.
    loss : float
        Loss factor of the material.
    eta, beta : float
        The body's own damping, of K: loss factor, and [s].
    """

    slope: float = 1.0
    loss: float = 0.0
    eta: float = 0.0
    beta: float = 0.0
    kind = "parameter"

    @property
    def words(self) -> str:
        return f"a parameter from {self.least:g} to {self.most:g}, {self.value:g} now"

    @property
    def stiffness(self) -> float:
        """Of T, beside K."""
        return self.slope * (self.value - self.least)

    def at(self, omega: ArrayLike) -> ComplexArray:
        w = np.asarray(omega, dtype=float)
        g: ComplexArray = self.stiffness * (1 + 1j * (self.loss + self.eta + w * self.beta))
        return g


@dataclass(frozen=True, eq=False)
class Product(Varying):
    """p slope g(ω): a parameter p times another law, whatever that is of. p is named like the term,
    up to a colon.

    Attributes
    ----------
    least, most, value : float
        p is between the first two; what it is at present.
    slope : float
        One over the unit of p, of what T is at one.
    factor : Law
        g: ``Viscous``, ``Loss`` of 1, ``Prony``, ``Table`` or ``Circulatory``.
    """

    factor: Law
    slope: float = 1.0

    @property
    def kind(self) -> str:
        return f"{PRODUCT}{self.factor.kind}"

    def parameter(self, term: str) -> str:
        return term.partition(":")[0]

    def numbers(self) -> dict[str, Floats]:
        own = {name: np.array([getattr(self, name)]) for name in OF_PRODUCT}
        return own if isinstance(self.factor, Loss) else own | self.factor.numbers()

    @property
    def words(self) -> str:
        return (
            f"{'loss factor' if isinstance(self.factor, Loss) else self.factor.words}, times a "
            f"parameter from {self.least:g} to {self.most:g}, {self.value:g} now"
        )

    @property
    def times(self) -> float:
        """What multiplies T beside g."""
        return self.slope * self.value

    def at(self, omega: ArrayLike) -> ComplexArray:
        return self.times * self.factor.at(omega)


def parameter(
    least: float, most: float, value: float | None = None, *, slope: float = 1.0, loss: float = 0.0
) -> Parameter:
    """The law (p - least) slope (1 + i loss) of a stiffness that is known between two numbers.

    A term with it is named like the parameter p. K holds the stiffness at the least p, the term's
    matrix T what it grows by. The claim of a reduction holds with several values of p, and
    ``ReducedModel.at`` gives the body with one of them. What damps K, α, β and η of the body,
    damps T too.

    Parameters
    ----------
    least, most : float
        p is between these.
    value : float, optional
        What it is unless something else is said; default the geometric mean, or half way where the
        least is not positive.
    slope : float
        Of the stiffness: it is T times slope times (p - least) beside K.
    loss : float
        Loss factor of this stiffness, beside the body's η.

    Raises
    ------
    BodyError
        For numbers that do not rise, or are negative where they must not be.

    Examples
    --------
    >>> flexgram.parameter(1e6, 4e6).value # N/m of a spring, K with 1e6, T of 1 N/m
    2000000.0
    """
    if not (np.isfinite(least) and np.isfinite(most) and least < most):
        raise BodyError(f"parameter({least:g}, {most:g}): least and most must rise")
    if value is None:
        value = float(np.sqrt(least * most)) if least > 0 else 0.5 * (least + most)
    if not least <= value <= most:
        raise BodyError(f"parameter: value {value:g} must be from {least:g} to {most:g}")
    if not (np.isfinite(slope) and slope > 0 and np.isfinite(loss) and loss >= 0):
        raise BodyError("parameter: slope must be positive, and loss not negative")
    return Parameter(float(least), float(most), float(value), float(slope), float(loss))


def product(range: Parameter, law: Law) -> Product:
    """The law p slope g(ω) of a parameter p times another law g.

    A term with it is named NAME, or NAME:WORD where p is the parameter NAME of another term too.
    With g of dampers p is a damping, with ``loss(1)`` a loss factor. A viscoelastic material whose
    long-term modulus is a parameter has two terms of one matrix, the stiffness at a modulus of one:
    ``parameter``, and ``product`` of this with ``prony``. Dampers at rest that a frame at the speed
    Ω sees have the term ``speed:NAME`` with ``product(parameter(least, most), circulatory())``: its
    T is the damping matrix times the turn of a unit speed (docs/rotors.md).

    Parameters
    ----------
    range : Parameter
        With the numbers of p, not negative, and the slope. Its loss must be zero.
    law : Law
        g: ``viscous()``, ``loss(eta)``, ``prony(g, tau)``, ``table(omega, storage, loss)`` or
        ``circulatory()``.

    Raises
    ------
    BodyError
        For another g, or numbers of p that are negative.

    Examples
    --------
    >>> E = flexgram.parameter(1e6, 4e6)
    >>> relaxation = flexgram.product(E, flexgram.prony(0.5, 1e-3))
    >>> terms = {"E": (T, E), "E:relaxation": (T, relaxation)}  # doctest: +SKIP
    >>> flexgram.product(flexgram.parameter(100, 300, 200), flexgram.viscous()).at(1.0)
    200j
    """
    if not isinstance(law, (Viscous, Loss, Prony, Table, Circulatory)):
        raise BodyError(
            "product: a parameter multiplies viscous(), loss(eta), prony(g, tau), table(omega, "
            "storage, loss) or circulatory()"
        )
    if range.least < 0 or range.loss:
        raise BodyError(
            f"product: the parameter from {range.least:g} to {range.most:g} must not be negative, "
            "and has no loss factor of its own"
        )
    slope = range.slope
    if isinstance(law, Loss):
        slope, law = slope * law.eta, Loss(1.0)
    if not slope > 0:
        raise BodyError("product: a loss factor of zero")
    return Product(range.least, range.most, range.value, law, slope)


def _speeds(law: str, least: float, most: float, value: float | None) -> list[float]:
    if not (np.isfinite(least) and np.isfinite(most) and 0 <= least < most):
        raise BodyError(f"{law}({least:g}, {most:g}): speeds must rise from 0 or more")
    if value is None:
        value = most
    if not least <= value <= most:
        raise BodyError(f"{law}: speed {value:g} must be from {least:g} to {most:g}")
    return [float(least), float(most), float(value)]


def spin(least: float, most: float, value: float | None = None, *, power: int = 2) -> Spin:
    """The law Ω² - least² of what a spin adds to the stiffness, in the frame that turns.

    The term's matrix T is that at Ω = 1 rad/s: the stress stiffness of the centrifugal load less
    the softening M_c. It may have negative eigenvalues. K holds it at the least speed. With
    ``coriolis`` of the same speeds the body has one parameter, ``speed``.

    Parameters
    ----------
    least, most : float
        Ω is between these [rad/s].
    value : float, optional
        What it is unless something else is said; default the most.
    power : int
        4: Ω⁴ - least⁴, of what moved geometry adds at second order; T is positive semidefinite.

    Raises
    ------
    BodyError
        For other numbers.

    Examples
    --------
    >>> flexgram.spin(0, 100).at(0.0) # at 100 rad/s
    array(10000.+0.j)
    """
    if power not in (2, 4):
        raise BodyError(f"spin: power {power} must be 2 or 4")
    first, last, now = _speeds("spin", least, most, value)
    return Spin(first, last, now, power)


def coriolis(least: float, most: float, value: float | None = None) -> Coriolis:
    """The law iωΩ of Coriolis forces, or of gyroscopic moments, of a body that spins.

    The term's matrix T is skew, that at Ω = 1 rad/s: in the frame that turns with the body
    2∫ρ u·(Ω × v).

    Parameters
    ----------
    least, most, value : float
        As of ``spin``.

    Raises
    ------
    BodyError
        For other numbers.

    Examples
    --------
    >>> terms = {"coriolis": (G, flexgram.coriolis(0, 100))}  # doctest: +SKIP
    """
    return Coriolis(*_speeds("coriolis", least, most, value))
