"""Damping of a whole body."""

from __future__ import annotations

import math

from flexgram.basics import BodyError
from flexgram.body.reader import Reader


def rayleigh(words: str, where: str = "--zeta") -> tuple[float, float]:
    """alpha [1/s] and beta [s] of a damping ratio at two frequencies: zeta = alpha/(2 ω) + beta ω/2
    at both.

    Parameters
    ----------
    words : str
        Ratio and two frequencies [Hz].
    where : str
        Of messages.

    Raises
    ------
    BodyError
        If they are something else.

    Examples
    --------
    >>> alpha, beta = rayleigh("1%,50,2000")
    >>> print(f"{alpha:.4f} {beta:.4e}")
    6.1299 1.5528e-06
    """
    ratio, *hertz = words.split(",")
    try:
        zeta = float(ratio.strip().rstrip("%")) * (0.01 if "%" in ratio else 1.0)
        first, last = sorted(2 * math.pi * float(word) for word in hertz)
    except ValueError:
        zeta = first = last = math.nan
    if not (0 < zeta < 1 and 0 < first < last < math.inf):
        raise BodyError(
            f"{where} {words}: expected a ratio below 1 and two frequencies [Hz], as in 1%,50,2000"
        )
    return 2 * zeta * first * last / (first + last), 2 * zeta / (first + last)


def by_ratio(
    zeta: str | None, alpha: float | None, beta: float | None, where: str = "zeta"
) -> tuple[float | None, float | None]:
    """alpha and beta as given, or by a ratio at two frequencies.

    Raises
    ------
    BodyError
        Where both are given.
    """
    if zeta is None:
        return alpha, beta
    if alpha is not None or beta is not None:
        raise BodyError(f"{where} gives alpha and beta: leave these out")
    return rayleigh(zeta, where)


def described(reader: Reader) -> dict[str, float]:
    """``alpha`` [1/s], ``beta`` [s] and ``eta`` of a description's ``damping``, by ``zeta`` too.

    Raises
    ------
    BodyError
        For other keys, or where zeta is given beside alpha or beta.
    """
    damping = Reader(reader.get("damping", {}) or {}, "damping", ("alpha", "beta", "eta", "zeta"))
    found = {key: damping.number(key, 0.0) for key in ("alpha", "beta", "eta")}
    zeta = damping.data.get("zeta")
    if zeta is not None:
        if found["alpha"] or found["beta"]:
            raise BodyError("damping: zeta gives alpha and beta: leave these out")
        words = ",".join(map(str, zeta)) if isinstance(zeta, list) else str(zeta)
        found["alpha"], found["beta"] = rayleigh(words, "damping: zeta")
    return found
