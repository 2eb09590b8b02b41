"""YAML mappings read with the place of every mistake named."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from flexgram.basics import BodyError


class UniqueKeys(yaml.SafeLoader):
    """YAML that refuses a key given twice, where PyYAML would drop the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise BodyError(f"line {node.start_mark.line + 1}: the key {key} is given twice")
        return super().construct_mapping(node, deep)


def short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."


#: Of a material's or spring's stiffness, beside the body's own eta.
LOSS = "loss_factor"


class Reader:
    """Typed access to a YAML mapping that names the place of every mistake."""

    def __init__(self, data: Any, where: str, known: tuple[str, ...] | None = None) -> None:
        if not isinstance(data, dict):
            raise BodyError(f"{where} must be a mapping, not {short(data)}")
        self.data, self.where = data, where
        if known is not None:
            for key in data:
                if key not in known:
                    raise BodyError(f"{where}: unknown key {key}; there are {', '.join(known)}")

    def get(self, key: str, default: Any = None) -> Any:
        if key not in self.data and default is None:
            raise BodyError(f"{self.where}: {key} is missing")
        return self.data.get(key, default)

    def number(self, key: str, default: float | None = None) -> float:
        value = self.get(key, default)
        try:
            if isinstance(value, bool):
                raise TypeError
            number = float(value)  # YAML reads 210e9 as text
        except (TypeError, ValueError):
            raise BodyError(f"{self.where}: {key} = {value!r} must be a number") from None
        if not math.isfinite(number):
            raise BodyError(f"{self.where}: {key} = {value!r} must be finite")
        return number

    def vector(self, key: str, default: Any = None) -> NDArray[np.float64]:
        value = self.get(key, default)
        try:
            vector = np.array([float(x) for x in value])
        except (TypeError, ValueError):
            raise BodyError(f"{self.where}: {key} = {value!r} must be three numbers") from None
        if vector.shape != (3,) or not np.all(np.isfinite(vector)):
            raise BodyError(f"{self.where}: {key} = {value!r} must be three finite numbers")
        return vector

    def loss_factor(self) -> float:
        loss = self.number(LOSS)
        if not 0 <= loss < 10:
            raise BodyError(f"{self.where}: {LOSS} = {loss:g} must be from 0 to 10")
        return loss

    def choice(self, key: str, known: Any, default: str | None = None) -> str:
        value = self.get(key, default)
        if value not in known:
            raise BodyError(f"{self.where}: {key} = {value!r} must be one of {', '.join(known)}")
        return str(value)

    def children(self, key: str) -> dict[str, Any]:
        value = self.data.get(key) or {}
        return Reader(value, f"{self.where}: {key}").data
