"""Bodies made by other people, where they lie beside the project, and a job for each."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from flexgram import write_matrices

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_case(name: str) -> dict[str, Any]:
    """K, M, B … of one of them."""
    spec = importlib.util.spec_from_file_location("load_case", SHARED / "load_case.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    case: dict[str, Any] = module.load_case(str(SHARED / name))
    return case


def frequencies(K: Any, M: Any) -> Any:
    """Some undamped eigenfrequencies [Hz], ascending."""
    if K.shape[0] < 1500:
        scale = 1e-6 * abs(K).max() / abs(M).max()
        mu = sl.eigh(M.toarray(), (K + scale * M).toarray(), eigvals_only=True)
        squares = 1 / np.maximum(mu, 1e-300) - scale
    else:
        shift = -1e-9 * abs(K).max() / abs(M).max()
        squares = eigsh(K, 16, M, sigma=shift, return_eigenvectors=False)
    return np.sort(np.sqrt(np.abs(squares))) / (2 * np.pi)


def write_case(case: dict[str, Any], path: Path) -> tuple[float, float]:
    """Body file of a case, lightly damped if it has no damping; a band with ten modes."""
    K, M = case["K"].tocsc(), case["M"].tocsc()
    n = K.shape[0]
    hz = frequencies(K, M)
    elastic = hz[hz > 1e-4 * hz[min(12, len(hz) - 1)]]
    top = elastic[min(10, len(elastic) - 1) - 1]
    reference = case.get("ref", {})
    options: dict[str, Any] = {}
    if "D" in case:
        options["D"] = case["D"]
    elif reference.get("alpha") is not None:
        options.update(alpha=reference["alpha"], beta=reference["beta"])
    else:
        options.update(alpha=0.04 * np.pi * elastic[0], beta=0.002 / (np.pi * top))
    B = case.get("B")
    if B is None:
        B = np.zeros((n, 4))
        B[np.random.default_rng(1).choice(n, 4, replace=False), range(4)] = 1
    B = B.toarray() if sp.issparse(B) else B
    C = case.get("C")
    if C is not None:
        C = C.toarray() if sp.issparse(C) else C
        if C.shape != B.T.shape or not np.allclose(C, B.T):
            options["C"] = C
    write_matrices(path, K, M, B, **options)
    return 0.1 * elastic[0], 1.02 * top
