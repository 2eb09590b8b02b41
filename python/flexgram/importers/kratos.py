"""Kratos Multiphysics: K and M of a model part of its structural application, shells among them.

``matrices`` takes a model part in memory; what it returns goes into ``import_matrices`` like the
matrices of any other code. Serial: Kratos' own assembly on one process.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from flexgram.basics import BodyError
from flexgram.importers.fe import FeMatrices, symmetric

#: Values of Kratos' BUILD_LEVEL for its eigenvalue scheme.
MASS, STIFFNESS = 1, 2
#: Meshio's names by the dimension of an element and its number of nodes, where orders agree.
CELLS = {
    (1, 2): "line",
    (2, 3): "triangle",
    (2, 4): "quad",
    (3, 4): "tetra",
    (3, 10): "tetra10",
    (3, 8): "hexahedron",
}


def _unknowns(kratos: Any) -> list[Any]:
    """Variables of the components 0-5."""
    return [
        getattr(kratos, f"{kind}_{axis}") for kind in ("DISPLACEMENT", "ROTATION") for axis in "XYZ"
    ]


def _assembled(part: Any, kratos: Any, application: Any) -> list[sp.csr_matrix]:
    """K and M over the free dofs, as Kratos numbers them."""
    from KratosMultiphysics.scipy_conversion_tools import to_csr

    scheme = application.EigensolverDynamicScheme()
    builder = kratos.ResidualBasedEliminationBuilderAndSolver(kratos.LinearSolver())
    strategy = kratos.ResidualBasedLinearStrategy(part, scheme, builder, False, False, False, False)
    strategy.Initialize()
    strategy.Check()
    strategy.InitializeSolutionStep()
    matrix, load = strategy.GetSystemMatrix(), strategy.GetSystemVector()
    found = []
    for level in (STIFFNESS, MASS):
        part.ProcessInfo[application.BUILD_LEVEL] = level
        kratos.SparseSpace().SetToZeroMatrix(matrix)
        builder.Build(scheme, part, matrix, load)
        entries = sp.coo_matrix(to_csr(matrix), copy=True)  # the matrix is used again
        found.append(symmetric(part.Name, entries.row, entries.col, entries.data, entries.shape[0]))
    return found


def matrices(part: Any) -> FeMatrices:
    """K, M and the places of their rows.

    Parameters
    ----------
    part : KratosMultiphysics.ModelPart
        With elements, properties and dofs, as an analysis has it after ``Initialize``. Dofs that
        are fixed have no rows; sub model parts become node sets; Rayleigh damping is read.

    Returns
    -------
    FeMatrices
        For ``flexgram.importers.import_matrices``, which says how many rigid motions K has.

    Raises
    ------
    BodyError
        For multi-point constraints, which Kratos keeps beside its matrices, or without dofs.

    Examples
    --------
    >>> import KratosMultiphysics as km
    >>> from KratosMultiphysics import StructuralMechanicsApplication
    >>> part = km.Model().CreateModelPart("empty")
    >>> matrices(part)
    Traceback (most recent call last):
        ...
    flexgram.basics.BodyError: ...
    """
    import KratosMultiphysics as kratos
    import KratosMultiphysics.StructuralMechanicsApplication as application

    if part.NumberOfMasterSlaveConstraints():
        raise BodyError(
            f"{part.Name}: multi-point constraints are not in Kratos' matrices: couple "
            "the nodes here (--rigid, --distributing)"
        )
    unknowns = _unknowns(kratos)
    own = [
        (node, component)
        for node in part.Nodes
        for component, unknown in enumerate(unknowns)
        if node.HasDofFor(unknown) and not node.IsFixed(unknown)
    ]
    if not own:
        raise BodyError(f"{part.Name}: no displacement of its nodes is an unknown")
    K, M = _assembled(part, kratos, application)
    # Kratos numbers the equations while it assembles.
    rows = sorted((node.GetDof(unknowns[c]).EquationId, node.Id, c) for node, c in own)
    equation, node, component = np.array(rows, dtype=np.int64).T
    if not np.array_equal(equation, np.arange(K.shape[0])):
        raise BodyError(f"{part.Name}: it has unknowns beside displacements and rotations")
    blocks: dict[str, list[list[int]]] = {}
    for element in part.Elements:
        geometry = element.GetGeometry()
        size = geometry.LocalSpaceDimension(), geometry.PointsNumber()
        if size in CELLS:
            blocks.setdefault(CELLS[size], []).append([point.Id for point in geometry])
    info = part.ProcessInfo
    alpha, beta = (
        float(info[variable]) if info.Has(variable) else 0.0
        for variable in (application.RAYLEIGH_ALPHA, application.RAYLEIGH_BETA)
    )
    return FeMatrices(
        source=part.Name,
        K=K,
        M=M,
        node=node,
        component=component,
        labels=np.array([n.Id for n in part.Nodes], dtype=np.int64),
        points=np.array([[n.X0, n.Y0, n.Z0] for n in part.Nodes]),
        sets={
            sub.Name: np.array([n.Id for n in sub.Nodes], dtype=np.int64)
            for sub in part.SubModelParts
        },
        blocks=[(kind, np.array(nodes, dtype=np.int64)) for kind, nodes in blocks.items()],
        thin=not any(kind.startswith(("tetra", "hexa")) for kind in blocks),
        alpha=alpha,
        beta=beta,
    )
