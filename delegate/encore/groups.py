"""What a walk over the stage finds: groups of prims that are placed together, and the prims that were met."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Sdf, Usd, UsdGeom

from encore.adapters.authored import Authored
from encore.adapters.context import Matrix
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import Matrices
from encore.adapters.matrix_motion import MatrixKeys, Moving
from encore.adapters.shading_rate import RateArray
from encore.report import Reports, Severity


@dataclass(slots=True, eq=False)
class Rprim:
    """What is rendered by itself. matrix: to its group's space. inherited: primvars of its ancestors.

    authored: names of its properties. moving: how it moves in its group. light: the prim (itself, or a
    GeometryLight) by which it emits. source: the path that notices of changes name: of instance proxies,
    that in the prototype. entry: what encore.rprim_cache knows.
    """

    prim: Usd.Prim
    path: Sdf.Path
    type_name: str
    authored: Authored
    matrix: Matrix
    inherited: list[UsdGeom.Primvar]
    subsets: list[UsdGeom.Subset]
    moving: Moving | None = None
    light: Usd.Prim | None = None
    source: Sdf.Path = Sdf.Path.emptyPath
    entry: Any = None


@dataclass(frozen=True)
class LightPrim:
    """A light of a supported type. matrix: to its group's space. moves: with time, in its group."""

    prim: Usd.Prim
    matrix: Matrix
    moves: bool = False


@dataclass(frozen=True)
class Placement:
    """Where a group is placed in its parent group. ids: of the instances of a PointInstancer.

    bound: the prim whose material all of the group inherits, where that differs between placements.
    rates: shading rates per matrix, which win over all rates inside where above 0. motion: (n, k, 4, 4),
    where any of the n matrices moves. primvars: per matrix, by name. inherits: whether it is below its parent
    group in namespace, and so inherits what instances of that pass down.
    """

    group: Group
    matrices: Matrices
    path: str
    ids: npt.NDArray[np.int64] | None = None
    bound: Usd.Prim | None = None
    rates: RateArray | None = None
    motion: MatrixKeys | None = None
    primvars: InstancePrimvars = field(default_factory=dict)
    inherits: bool = True


@dataclass(eq=False)
class Group:
    """Prims that are placed together. uniform: no material is bound inside, all is inherited from outside.

    top: its walk. key: by what its instances are told from others; None for the root. root: that of the
    prototype, of those of PointInstancers.
    """

    path: Sdf.Path
    uniform: bool = False
    rprims: list[Rprim] = field(default_factory=list)
    lights: list[LightPrim] = field(default_factory=list)
    children: list[Placement] = field(default_factory=list)
    top: Node | None = None
    key: Any = None
    root: Sdf.Path | None = None


class Kind(enum.Enum):
    CONTAINER = enum.auto()  # nothing to render itself, descendants may be
    RPRIM = enum.auto()
    INSTANCER = enum.auto()
    LIGHT = enum.auto()
    GEOMETRY_LIGHT = enum.auto()
    UNSUPPORTED = enum.auto()
    UNSUPPORTED_LIGHT = enum.auto()
    SKIP = enum.auto()  # neither it nor its descendants are rendered


@dataclass(frozen=True, slots=True)
class PrimType:
    """What all prims of one type, with the same applied schemas, have in common.

    asks: its visibility, purpose or transform may differ from the schema's fallback without being authored.
    unsupported: some of its applied schemas are.
    """

    name: str
    kind: Kind
    imageable: bool
    binds: bool
    emits: bool
    model: bool
    asks: bool
    unsupported: bool


# Of material bindings on a prim and its ancestors: purpose → (material, strongerThanDescendants).
Bindings = tuple[tuple[str, str, bool], ...]


@dataclass(slots=True, eq=False)
class State:
    """What a prim inherits. matrix: its parent's, to the group's space; with is_own, the prim's.

    collections: True where a prim above binds materials to collections.
    rates_root: the instance that the group's shading rates are left to, and those of prims above it with it.
    given_root: the same of the primvars that instances give to what is placed.
    moving: its motion in the group's space. clips: whether values may come from clips.
    """

    matrix: Gf.Matrix4d
    purpose: Any = None
    primvars: list[UsdGeom.Primvar] = field(default_factory=list)
    bindings: Bindings = ()
    collections: bool = False
    is_own: bool = False
    rates_root: Sdf.Path | None = None
    moving: Moving | None = None
    given_root: Sdf.Path | None = None
    clips: bool = False


class Node:
    """A prim that the walk of a group has met. state: what its children inherit; None: they are not walked.

    items: what it puts into its group: rprims, lights, placements. log: reports (arguments of Reports.add),
    and groups where they were asked for, in this order; None: nothing. varies: with time; None: unknown.
    """

    __slots__ = ("authored", "children", "items", "kind", "log", "parent", "path", "prim", "state", "varies")

    def __init__(self, prim: Usd.Prim, path: Sdf.Path, parent: Node | None) -> None:
        self.prim = prim
        self.path = path
        self.parent = parent
        self.kind = Kind.CONTAINER
        self.authored: Authored | None = None
        self.state: State | None = None
        self.items: tuple[Any, ...] = ()
        self.log: list[Any] | None = None
        self.children: list[Node] = []
        self.varies: bool | None = None


class Recorder(Reports):
    """Keeps what is reported with the node that is being visited."""

    def __init__(self) -> None:
        super().__init__()
        self.node: Node | None = None

    def add(
        self, kind: str, message: str, path: Sdf.Path | str, severity: Severity = Severity.WARNING
    ) -> None:
        self.note_item((kind, message, path, severity))

    def note_item(self, item: Any) -> None:
        assert self.node is not None, "reports come from visits"
        if self.node.log is None:
            self.node.log = []
        self.node.log.append(item)
