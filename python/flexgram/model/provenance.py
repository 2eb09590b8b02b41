"""How a reduced body was made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self


@dataclass(frozen=True)
class Provenance:
    """The group ``/log`` of a reduced file, and the method.

    Attributes
    ----------
    method, second_stage : str
        As in the options of flexgram.
    body : str
        File of the body, or its name if it was handed over in memory.
    plan : list of (str, str)
        What was done and what was skipped.
    warnings : list of str
        What the program warned of when it made the body.
    seconds : dict
        Time by stage [s].
    log : dict
        All that ``/log`` holds: ``factorisations``, ``medium_order``, ``options``, ``versions``,
        ``ranks``, ``peak_memory_mb_per_rank`` and those above.
    """

    method: str = ""
    second_stage: str = ""
    body: str = ""
    plan: list[tuple[str, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    log: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Self:
        """From the fields of a reduced body."""
        log = {
            name.removeprefix("log/"): value
            for name, value in fields.items()
            if name.startswith("log/")
        }
        lines = (str(line).partition("\t") for line in log.get("plan", []))
        log["plan"] = [(name, words) for name, _, words in lines]
        return cls(
            method=str(fields.get("method", "")),
            second_stage=str(fields.get("second_stage", "")),
            body=str(log.get("body", "")),
            plan=log["plan"],
            warnings=[str(said) for said in log.get("warnings", [])],
            seconds={stage: float(s) for stage, s in dict(log.get("seconds", {})).items()},
            log=log,
        )

    @property
    def words_of_curve(self) -> str:
        """What the curve of errors in the file is, beside the bound: of an assembly the medium
        model is not at hand."""
        return "estimated error" if self.method == "couple" else "error against the medium model"

    @property
    def stages(self) -> str:
        """Method, with the second stage if it is another word."""
        more = self.second_stage not in ("", self.method)
        return f"{self.method} ({self.second_stage})" if more else self.method
