"""Laws by which the matrix of a term counts at a frequency."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats


@dataclass(frozen=True)
class Law(ABC):
    """The factor g of a term g(ω)T."""

    @property
    @abstractmethod
    def kind(self) -> str:
        """Its name in files."""

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
class Circulatory(Law):
    """1, of a skew matrix T: forces of oil films, of friction, of loads that follow a body."""

    kind = "circulatory"

    @property
    def words(self) -> str:
        return "circulatory forces"

    def at(self, omega: ArrayLike) -> ComplexArray:
        g: ComplexArray = np.ones(np.shape(omega), dtype=np.complex128)
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
