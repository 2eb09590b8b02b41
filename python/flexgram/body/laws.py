"""Terms of a body beside K and M: a matrix, and the law by which it counts at a frequency."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats, check_name

#: The parameter of bodies that spin, [rad/s].
SPEED = "speed"


@dataclass(frozen=True)
class Law(ABC):
    """The factor g of a term g(ω)T."""

    #: Its name in files.
    kind: ClassVar[str]

    @abstractmethod
    def at(self, omega: ArrayLike) -> ComplexArray:
        """g at frequencies omega [rad/s], of their shape."""

    def numbers(self) -> dict[str, Floats]:
        """What it is made of, as files hold it."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    @property
    @abstractmethod
    def words(self) -> str:
        """A phrase for messages."""


@dataclass(frozen=True)
class Viscous(Law):
    """iω: dampers."""

    kind = "viscous"
    words = "viscous"

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = 1j * np.asarray(omega, dtype=float)
        return g


@dataclass(frozen=True)
class Loss(Law):
    """iη: a loss factor.

    Attributes
    ----------
    eta : float
    """

    eta: float
    kind = "structural"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.eta) and self.eta >= 0):
            raise BodyError(f"loss({self.eta}): a loss factor is finite and not negative")

    @property
    def words(self) -> str:
        return f"loss factor {self.eta:g}"

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = np.full(np.shape(omega), 1j * self.eta)
        return g


def _lists(law: str, **given: ArrayLike) -> list[Floats]:
    """Vectors of one length, finite."""
    lists = []
    for name, values in given.items():
        array = np.atleast_1d(np.asarray(values, dtype=float))
        if array.ndim != 1 or not np.all(np.isfinite(array)):
            raise BodyError(f"{law}: {name} must be a list of finite numbers")
        lists.append(array)
    if len({len(array) for array in lists}) > 1 or len(lists[0]) == 0:
        counts = ", ".join(f"{name} {len(x)}" for name, x in zip(given, lists, strict=True))
        raise BodyError(f"{law}: lists of one length, one number or more, not {counts}")
    return lists


@dataclass(frozen=True, eq=False)
class Prony(Law):
    """Σ g_k iωτ_k/(1 + iωτ_k): relaxation, beside the long-term stiffness that K holds.

    Attributes
    ----------
    g, tau : (k,) arrays
        Shares of T, and relaxation times [s].
    """

    g: Floats
    tau: Floats
    kind = "prony"

    @property
    def words(self) -> str:
        return f"{len(self.g)} Prony term{'s' * (len(self.g) > 1)}"

    def at(self, omega: ArrayLike) -> ComplexArray:
        z = 1j * np.asarray(omega, dtype=float)[..., None] * self.tau
        g: ComplexArray = ((z / (1 + z)) @ self.g).astype(np.complex128)
        return g


@dataclass(frozen=True, eq=False)
class Table(Law):
    """storage + i loss at some frequencies, linear in ω between them, constant beyond.

    Attributes
    ----------
    omega, storage, loss : (k,) arrays
        [rad/s], shares of T beside what K holds.
    """

    omega: Floats
    storage: Floats
    loss: Floats
    kind = "table"

    @property
    def words(self) -> str:
        return f"a table of {len(self.omega)} frequencies"

    def at(self, omega: ArrayLike) -> ComplexArray:
        w = np.asarray(omega, dtype=float)
        g: ComplexArray = np.interp(w, self.omega, self.storage) + 1j * np.interp(
            w, self.omega, self.loss
        )
        return g

    def line(self, omega: float) -> tuple[complex, complex]:
        """Value at zero and slope [s] of the line that g is about a frequency [rad/s]; at one of
        the table that of one side."""
        k = int(np.searchsorted(self.omega, omega))
        if k == 0 or k == len(self.omega):
            return complex(self.at(omega)), 0j
        ends = self.omega[k - 1 : k + 1]
        low, high = self.at(ends)
        slope = complex(high - low) / float(ends[1] - ends[0])
        return complex(low) - slope * float(ends[0]), slope

    @property
    def largest(self) -> float:
        """|g| at most."""
        return float(np.abs(self.storage + 1j * self.loss).max())


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
class Circulatory(Law):
    """1, of a skew matrix T: forces of oil films, of friction, of loads that follow a body."""

    kind = "circulatory"

    @property
    def words(self) -> str:
        return "circulatory forces"

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = np.ones(np.shape(omega), dtype=np.complex128)
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


def viscous() -> Viscous:
    """The law iω of dampers: a term of D.

    Examples
    --------
    >>> flexgram.viscous().at(10.0)
    10j
    """
    return Viscous()


def loss(eta: float) -> Loss:
    """The law iη of a loss factor: a term of S.

    Parameters
    ----------
    eta : float
        Loss factor of the term's stiffness.

    Examples
    --------
    >>> terms = {"rubber": (K_rubber, flexgram.loss(0.2))}  # doctest: +SKIP
    """
    return Loss(eta)


def prony(g: ArrayLike, tau: ArrayLike) -> Prony:
    """The law Σ g_k iωτ_k/(1 + iωτ_k) of a viscoelastic material (generalised Maxwell model).

    K holds the long-term stiffness, the term T the same of the material alone; then g counts
    from the long-term modulus. Shares ḡ of the instantaneous one are g = ḡ/(1 - Σ ḡ).

    Parameters
    ----------
    g, tau : (k,) arrays
        Shares of T, not negative, and relaxation times [s], positive.

    Raises
    ------
    BodyError
        For other numbers.

    Examples
    --------
    >>> abs(flexgram.prony([0.8, 0.5], [1e-3, 1e-4]).at(1e9)) # all of it, at once
    1.3
    """
    shares, times = _lists("prony", g=g, tau=tau)
    if np.any(shares < 0) or np.any(times <= 0):
        raise BodyError("prony: g must not be negative, and tau must be positive")
    return Prony(shares, times)


def table(omega: ArrayLike, storage: ArrayLike, loss: ArrayLike) -> Table:
    """The law storage + i loss of a viscoelastic material, by frequency.

    Between the frequencies both are linear in ω; a band must lie within them. K holds the least
    stiffness, so that storage counts from there and is not negative.

    Parameters
    ----------
    omega : (k,) array
        Rising frequencies [rad/s].
    storage, loss : (k,) arrays
        Shares of T, beside what K holds.

    Raises
    ------
    BodyError
        For other numbers.

    Examples
    --------
    >>> flexgram.table([0, 100], [0.0, 1.0], [0.1, 0.3]).at(50.0)
    (0.5+0.2j)
    """
    w, real, imaginary = _lists("table", omega=omega, storage=storage, loss=loss)
    if w[0] < 0 or np.any(np.diff(w) <= 0):
        raise BodyError("table: omega must rise, from zero or more")
    if np.any(real < 0) or np.any(imaginary < 0):
        raise BodyError(
            "table: storage and loss must not be negative: K holds the least stiffness, and "
            "storage counts from there"
        )
    return Table(w, real, imaginary)


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


def circulatory() -> Circulatory:
    """The law 1 of a skew stiffness: circulatory forces.

    A K that is not symmetric is the sum of its symmetric part and of such a term; bodies are read
    so.

    Examples
    --------
    >>> flexgram.circulatory().at(10.0)
    array(1.+0.j)
    """
    return Circulatory()


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
    if kind not in known:
        raise BodyError(f"{where}: law {kind} must be one of {', '.join(known)}")
    made, make = known[kind]
    try:
        law: Law = make(*(numbers[entry.name] for entry in fields(made)))
    except KeyError as error:
        raise BodyError(f"{where}: law {kind} needs {error}") from None
    except BodyError as error:
        raise BodyError(f"{where}: {error}") from None
    return law


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
                "spin(least, most), coriolis(least, most) or circulatory()"
            )
        matrix, law = given
        if isinstance(law, Viscous):
            D = matrix if D is None else D + matrix
        elif isinstance(law, Loss):
            S = law.eta * matrix if S is None else S + law.eta * matrix
        else:
            if isinstance(law, Parameter) and name == SPEED:
                raise BodyError(f"term {name}: that is the parameter of bodies that spin")
            others.append(Term(check_name("term", str(name)), law, matrix))
    return D, S, others
