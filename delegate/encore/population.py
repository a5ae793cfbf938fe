"""What is on the stage and where: one walk over the prims that are visible and wanted.

The result is a tree of groups. A group holds prims that are placed together: all that is not instanced (the
root), the contents of a native prototype, or one prototype of a PointInstancer. Groups are shared by all
instances that would look the same, so that a prototype is translated once.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdVol

from encore.adapters import implicit, light
from encore.adapters.context import Matrix, SyncContext, to_matrix
from encore.adapters.instancer import Matrices, PrototypeScanner, read_point_instancer
from encore.adapters.material import bound_materials
from encore.adapters.matrix_motion import MatrixKeys, Moving, compose, inherit
from encore.adapters.primvars import inherited_signature, read_by_materials
from encore.adapters.shading_rate import RateArray, is_rate, read_native_rates


@dataclass(frozen=True)
class Rprim:
    """A mesh, or an implicit shape. matrix: to its group's space. inherited: primvars of its ancestors.

    moving: how it moves in its group. light: the prim (itself, or a GeometryLight) by which it emits.
    """

    prim: Usd.Prim
    matrix: Matrix
    inherited: list[UsdGeom.Primvar]
    subsets: list[UsdGeom.Subset]
    moving: Moving | None = None
    light: Usd.Prim | None = None


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
    where any of the n matrices moves.
    """

    group: Group
    matrices: Matrices
    path: str
    ids: npt.NDArray[np.int64] | None = None
    bound: Usd.Prim | None = None
    rates: RateArray | None = None
    motion: MatrixKeys | None = None


@dataclass
class Group:
    """Prims that are placed together. uniform: no material is bound inside, all is inherited from outside."""

    path: Sdf.Path
    uniform: bool = False
    rprims: list[Rprim] = field(default_factory=list)
    lights: list[LightPrim] = field(default_factory=list)
    children: list[Placement] = field(default_factory=list)


class _Kind(enum.Enum):
    CONTAINER = enum.auto()  # nothing to render itself, descendants may be
    RPRIM = enum.auto()
    INSTANCER = enum.auto()
    LIGHT = enum.auto()
    GEOMETRY_LIGHT = enum.auto()
    UNSUPPORTED = enum.auto()
    UNSUPPORTED_LIGHT = enum.auto()
    SKIP = enum.auto()  # neither it nor its descendants are rendered


# Of material bindings on a prim and its ancestors: purpose → (material, strongerThanDescendants).
_Bindings = tuple[tuple[str, str, bool], ...]


@dataclass(frozen=True)
class _State:
    """What a prim inherits. matrix: its parent's, to the group's space; with is_own, the prim's.

    collections: True where a prim above binds materials to collections.
    rates_root: the instance that the group's shading rates are left to, and those of prims above it with it.
    moving: its motion in the group's space.
    """

    matrix: Gf.Matrix4d
    purpose: Any = None
    primvars: list[UsdGeom.Primvar] = field(default_factory=list)
    bindings: _Bindings = ()
    collections: bool = False
    is_own: bool = False
    rates_root: Sdf.Path | None = None
    moving: Moving | None = None


_DRAW_MODES = ("origin", "bounds", "cards")
_DEFINED = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes of PointInstancers are often below an `over`, which hides them elsewhere.
_PROTOTYPES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)


class Population:
    """Walks the stage. purposes: of the prims that are wanted. material_purposes: of bindings, in order."""

    def __init__(
        self, purposes: Sequence[str], material_purposes: Sequence[str], context: SyncContext
    ) -> None:
        self._purposes = frozenset(purposes)
        self._material_purposes = tuple(material_purposes)
        self._context = context
        self._xforms = UsdGeom.XformCache(context.time)
        self._scanner = PrototypeScanner()
        self._kinds: dict[str, _Kind] = {}
        self._groups: dict[Any, Group] = {}
        self._open: list[Any] = []  # keys of groups that are being walked
        self._signatures: dict[int, tuple[list[UsdGeom.Primvar], tuple[object, ...]]] = {}
        self._split: dict[
            int, tuple[list[UsdGeom.Primvar], list[UsdGeom.Primvar], list[UsdGeom.Primvar]]
        ] = {}
        self._geometry_lights: dict[Sdf.Path, Usd.Prim] = {}  # by what emits
        self._read_primvars: frozenset[str] | None = None  # by any material; None: not looked for yet
        self.groups: list[Group] = []
        self.depth = 0  # of the deepest prim below the root

    def populate(self) -> Group:
        """The root group. All groups are then in `groups`, in the order in which they were met."""
        root = Group(Sdf.Path.absoluteRootPath)
        self.groups.append(root)
        prims = self._context.stage.GetPseudoRoot().GetFilteredChildren(_DEFINED)
        self._walk(root, prims, _State(Gf.Matrix4d(1)), _DEFINED)
        self._assign_geometry_lights()
        return root

    def world_matrix(self, prim: Usd.Prim) -> Matrix:
        """Local to world at the context's time."""
        return to_matrix(self._xforms.GetLocalToWorldTransform(prim))

    def _walk(self, group: Group, prims: list[Usd.Prim], state: _State, predicate: Any) -> None:
        stack = [(prim, state) for prim in reversed(prims)]
        while stack:
            prim, inherited = stack.pop()
            found = self._visit(group, prim, inherited)
            if found is not None:
                stack += [(child, found) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _visit(self, group: Group, prim: Usd.Prim, inherited: _State) -> _State | None:
        """Adds the prim to the group; what its children inherit, or None where they are not walked."""
        kind = self._kind(prim)
        if kind is _Kind.SKIP or self._is_invisible(prim):
            return None
        self.depth = max(self.depth, prim.GetPath().pathElementCount)
        matrix, moving = inherited.matrix, inherited.moving
        if not inherited.is_own:
            local, resets = self._xforms.GetLocalTransformation(prim)
            if self._context.shutter is not None:
                moving = inherit(prim, local, resets, matrix, moving, self._context)
            matrix = local if resets else local * matrix
        state = self._inherit(prim, matrix, moving, inherited)
        if kind is not _Kind.CONTAINER:
            self._add(kind, group, prim, state)
        if kind is _Kind.INSTANCER:
            return None
        if prim.IsInstance() and self._add_instance(group, prim, state):
            return None
        self._check_draw_mode(prim)
        return state

    def _kind(self, prim: Usd.Prim) -> _Kind:
        name = str(prim.GetTypeName())
        kind = self._kinds.get(name)
        if kind is None:
            kind = self._kinds[name] = _kind_of(prim, name)
        return kind

    def _is_invisible(self, prim: Usd.Prim) -> bool:
        visibility = prim.GetAttribute("visibility")
        return bool(visibility) and visibility.Get(self._context.time) == UsdGeom.Tokens.invisible

    def _inherit(
        self, prim: Usd.Prim, matrix: Gf.Matrix4d, moving: Moving | None, inherited: _State
    ) -> _State:
        purpose, primvars = inherited.purpose, inherited.primvars
        imageable = UsdGeom.Imageable(prim)
        if imageable:
            purpose = imageable.ComputePurposeInfo(purpose) if purpose else imageable.ComputePurposeInfo()
        if prim.GetAllChildrenNames() or prim.IsInstance():
            primvars = UsdGeom.PrimvarsAPI(prim).FindIncrementallyInheritablePrimvars(primvars) or primvars
        bindings, collections = inherited.bindings, inherited.collections
        if prim.HasAPI(UsdShade.MaterialBindingAPI):
            bindings = _merge_bindings(prim, bindings)
            collections = collections or _has_collection_binding(prim)
        return _State(
            matrix, purpose, primvars, bindings, collections, rates_root=inherited.rates_root, moving=moving
        )

    def _add(self, kind: _Kind, group: Group, prim: Usd.Prim, state: _State) -> None:
        path, reports = prim.GetPath(), self._context.reports
        if kind is _Kind.LIGHT:
            group.lights.append(LightPrim(prim, to_matrix(state.matrix), state.moving is not None))
            return
        if kind is _Kind.GEOMETRY_LIGHT:
            self._add_geometry_light(prim)
            return
        if kind is _Kind.UNSUPPORTED_LIGHT:
            name = prim.GetTypeName()
            reports.add(f"unsupported {name}", f"{name} is not supported yet, and is not rendered", path)
            return
        if kind is _Kind.INSTANCER:
            self._add_point_instancer(group, prim, state)
            return
        if state.purpose.purpose not in self._purposes:
            return
        if kind is _Kind.UNSUPPORTED:
            name = prim.GetTypeName()
            reports.add(f"unsupported {name}", f"{name} is not supported yet, and is not rendered", path)
            return
        emits = prim if prim.HasAPI(UsdLux.LightAPI) else None
        subsets = [UsdGeom.Subset(c) for c in prim.GetAllChildren() if c.IsA(UsdGeom.Subset)]
        group.rprims.append(
            Rprim(prim, to_matrix(state.matrix), state.primvars, subsets, state.moving, emits)
        )

    def _add_geometry_light(self, prim: Usd.Prim) -> None:
        relationship = UsdLux.GeometryLight(prim).GetGeometryRel()
        targets = relationship.GetForwardedTargets() if relationship else []
        if not targets:
            self._context.reports.error("bad light", "names no geometry, and does not emit", prim.GetPath())
        for target in targets:
            self._geometry_lights[target] = prim

    def _assign_geometry_lights(self) -> None:
        """Makes what GeometryLights name emit."""
        if not self._geometry_lights:
            return
        waiting = dict(self._geometry_lights)
        for group in self.groups:
            for i, rprim in enumerate(group.rprims):
                light_prim = waiting.pop(rprim.prim.GetPath(), None)
                if light_prim is not None:
                    group.rprims[i] = replace(rprim, light=light_prim)
        for target, light_prim in waiting.items():
            self._context.reports.add(
                "GeometryLight without geometry",
                f"does not emit: its geometry {target} is not rendered",
                light_prim.GetPath(),
            )

    def _check_draw_mode(self, prim: Usd.Prim) -> None:
        if prim.HasAPI(UsdGeom.ModelAPI):
            mode = UsdGeom.ModelAPI(prim).GetModelDrawModeAttr().Get(self._context.time)
            if mode in _DRAW_MODES:
                self._context.reports.add(
                    "draw mode",
                    f"draw mode {mode} is not supported yet: its full geometry is rendered",
                    prim.GetPath(),
                )

    # Instancing

    def _add_instance(self, group: Group, prim: Usd.Prim, state: _State) -> bool:
        """Places a native instance; False where its contents must be walked as if they were not shared."""
        prototype = prim.GetPrototype()
        traits = self._scanner.traits(prototype)
        if traits.resets:
            return False
        uniform = not traits.binds and not state.collections
        rate_primvars, others = self._split_rates(state.primvars)
        rates, own_rates = read_native_rates(prim, rate_primvars, self._context)
        if traits.rates:
            rates = own_rates
        else:
            state = replace(state, primvars=others, rates_root=prim.GetPath())
        key = (
            prototype.GetPath(),
            _inheritable_purpose(state.purpose),
            self._primvar_signature(state.primvars),
            None if uniform else self._binding_signature(prim, prototype, state),
        )
        children = prim.GetFilteredChildren(_DEFINED)
        child = self._group(key, prim.GetPath(), uniform, children, state, _DEFINED)
        if child is not None:
            bound = prim if uniform and not group.uniform else None
            matrices = to_matrix(state.matrix)[None]
            instance_rates = np.array([rates], np.float32) if any(rates) else None
            keys = state.moving.keys() if state.moving else None
            group.children.append(
                Placement(child, matrices, str(prim.GetPath()), None, bound, instance_rates, keys)
            )
        return True

    def _binding_signature(self, prim: Usd.Prim, prototype: Usd.Prim, state: _State) -> object:
        """Equal for instances whose prims are bound to the same materials."""
        if not state.collections:
            return state.bindings
        # Collections tell the prims inside of instances apart by their paths.
        root = prototype.GetPath()
        proxies = [
            self._context.stage.GetPrimAtPath(p.GetPath().ReplacePrefix(root, prim.GetPath()))
            for p in Usd.PrimRange(prototype, _DEFINED)
            if p.IsA(UsdGeom.Gprim) or p.IsA(UsdGeom.Subset)
        ]
        found = bound_materials(proxies, self._material_purposes)
        return tuple(str(m.GetPath()) if m else "" for m in found)

    def _add_point_instancer(self, group: Group, prim: Usd.Prim, state: _State) -> None:
        matrix = to_matrix(state.matrix)
        keys = state.moving.keys() if state.moving else None
        for placements in read_point_instancer(UsdGeom.PointInstancer(prim), self._context):
            root = placements.root
            inherited = self._state_above(root, state)
            key = (root.GetPath(), _inheritable_purpose(inherited.purpose), group.uniform)
            child = self._group(key, root.GetPath(), group.uniform, [root], inherited, _PROTOTYPES)
            if child is not None:
                group.children.append(
                    Placement(
                        child,
                        placements.matrices @ matrix,
                        str(prim.GetPath()),
                        placements.ids,
                        rates=placements.rates,
                        motion=compose(placements.matrices, placements.motion, matrix[None], keys),
                    )
                )

    def _state_above(self, root: Usd.Prim, instancer: _State) -> _State:
        """What the root of a PointInstancer's prototype inherits: from its ancestors, wherever it is.

        Its own transform is part of the instancer's matrices, and a purpose may come from the instancer.
        """
        parent = root.GetParent()
        bindings: _Bindings = ()
        collections = False
        for path in parent.GetPath().GetPrefixes():
            prim = self._context.stage.GetPrimAtPath(path)
            if prim.HasAPI(UsdShade.MaterialBindingAPI):
                bindings = _merge_bindings(prim, bindings)
                collections = collections or _has_collection_binding(prim)
        purpose = UsdGeom.Imageable(parent).ComputePurposeInfo() if UsdGeom.Imageable(parent) else None
        if not (purpose and purpose.isInheritable):
            purpose = instancer.purpose
        primvars = UsdGeom.PrimvarsAPI(parent).FindInheritablePrimvars()
        outside = instancer.rates_root
        if outside is not None and root.GetPath().HasPrefix(outside):
            primvars = self._split_rates(primvars)[1]
        else:
            outside = None
        return _State(
            Gf.Matrix4d(1), purpose, primvars, bindings, collections, is_own=True, rates_root=outside
        )

    def _group(
        self,
        key: Any,
        path: Sdf.Path,
        uniform: bool,
        prims: list[Usd.Prim],
        state: _State,
        predicate: Any,
    ) -> Group | None:
        """The group of the key, walked when first asked for; None, and a report, for one inside of itself."""
        if key in self._open:
            self._context.reports.error(
                "instancing cycle", "is a prototype of itself, and is not rendered", path
            )
            return None
        if key not in self._groups:
            group = self._groups[key] = Group(path, uniform)
            self.groups.append(group)
            self._open.append(key)
            self._walk(group, prims, replace(state, matrix=Gf.Matrix4d(1), moving=None), predicate)
            self._open.pop()
        return self._groups[key]

    def _primvar_signature(self, primvars: list[UsdGeom.Primvar]) -> tuple[object, ...]:
        known = self._signatures.get(id(primvars))
        if known is None:
            if self._read_primvars is None and primvars:
                self._read_primvars = read_by_materials(self._context.stage, self._context.time)
            # The list is kept, so that its id stays its own.
            known = self._signatures[id(primvars)] = (
                primvars,
                inherited_signature(primvars, self._context.time, self._read_primvars or ()),
            )
        return known[1]

    def _split_rates(
        self, primvars: list[UsdGeom.Primvar]
    ) -> tuple[list[UsdGeom.Primvar], list[UsdGeom.Primvar]]:
        """Shading rates, and the rest; always the same lists for the same list."""
        known = self._split.get(id(primvars))
        if known is None:
            rates = [p for p in primvars if is_rate(p)]
            rest = [p for p in primvars if not is_rate(p)] if rates else primvars
            known = self._split[id(primvars)] = (primvars, rates, rest)
        return known[1:]


def _inheritable_purpose(purpose: Any) -> str:
    return str(purpose.purpose) if purpose and purpose.isInheritable else ""


def _merge_bindings(prim: Usd.Prim, inherited: _Bindings) -> _Bindings:
    """Direct bindings of the prim over those of its ancestors, unless those are strongerThanDescendants."""
    merged = {purpose: (path, strong) for purpose, path, strong in inherited}
    api = UsdShade.MaterialBindingAPI(prim)
    for purpose in UsdShade.MaterialBindingAPI.GetMaterialPurposes():
        if merged.get(purpose, ("", False))[1]:
            continue
        relationship = api.GetDirectBindingRel(purpose)
        targets = relationship.GetForwardedTargets() if relationship else []
        if targets:
            strength = UsdShade.MaterialBindingAPI.GetMaterialBindingStrength(relationship)
            merged[purpose] = (str(targets[0]), strength == UsdShade.Tokens.strongerThanDescendants)
    return tuple((purpose, path, strong) for purpose, (path, strong) in sorted(merged.items()))


def _has_collection_binding(prim: Usd.Prim) -> bool:
    return any(name.startswith("material:binding:collection") for name in prim.GetAuthoredPropertyNames())


def _kind_of(prim: Usd.Prim, name: str) -> _Kind:
    if prim.IsA(UsdGeom.Mesh) or name in implicit.TYPES:
        return _Kind.RPRIM
    if prim.IsA(UsdGeom.PointInstancer):
        return _Kind.INSTANCER
    if name in light.TYPES:
        return _Kind.LIGHT
    if name == "GeometryLight":
        return _Kind.GEOMETRY_LIGHT
    if prim.IsA(UsdLux.BoundableLightBase) or prim.IsA(UsdLux.NonboundableLightBase) or name == "PluginLight":
        return _Kind.UNSUPPORTED_LIGHT
    if prim.IsA(UsdGeom.Subset) or prim.IsA(UsdShade.NodeGraph) or prim.IsA(UsdShade.Shader):
        return _Kind.SKIP
    if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdVol.Volume):
        return _Kind.UNSUPPORTED
    return _Kind.CONTAINER
