"""The walk over the prims of a group: what each of them is, where, and what those below it inherit."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade

from encore.adapters.authored import Authored, names_from_clips
from encore.adapters.context import SyncContext, to_matrix
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import PrototypeScanner
from encore.adapters.matrix_motion import Moving, inherit
from encore.adapters.skin_dependencies import INFLUENCES
from encore.adapters.unsupported import report_unsupported
from encore.groups import Bindings, Group, Kind, LightPrim, Node, PrimType, Recorder, Rprim, State
from encore.prim_type import prim_type

_DRAW_MODES = ("origin", "bounds", "cards")
IDENTITY = Gf.Matrix4d(1)  # what it is multiplied with stays as it is
_NO_PURPOSE = UsdGeom.Imageable.PurposeInfo(UsdGeom.Tokens.default_, False)


class StageWalk(ABC):
    """Visits prims. purposes: of those that are wanted. material_purposes: of bindings, in order."""

    aov_primvars: frozenset[str] = frozenset()  # that images show, whatever materials read

    def __init__(
        self, purposes: Sequence[str], material_purposes: Sequence[str], context: SyncContext
    ) -> None:
        self._purposes = frozenset(purposes)
        self._material_purposes = tuple(material_purposes)
        self._recorder = Recorder()
        self._types: dict[Any, PrimType] = {}
        self._authored: dict[tuple[str, ...], Authored] = {}
        self._context = context
        self._reset()

    def _set_context(self, context: SyncContext) -> None:
        self._context = replace(context, reports=self._recorder)
        self._xforms = UsdGeom.XformCache(context.time)
        self._has_prototypes = bool(context.stage.GetPrototypes())

    def _reset(self) -> None:
        self._scanner = PrototypeScanner()
        self._groups: dict[Any, Group] = {}
        self._open: list[Any] = []  # keys of groups that are being walked
        self._signatures: dict[int, tuple[list[UsdGeom.Primvar], tuple[object, ...]]] = {}
        self._split: dict[
            int, tuple[list[UsdGeom.Primvar], list[UsdGeom.Primvar], list[UsdGeom.Primvar]]
        ] = {}
        self._given: dict[int, tuple[list[UsdGeom.Primvar], InstancePrimvars, list[UsdGeom.Primvar]]] = {}
        self._read_primvars: frozenset[str] | None = None  # by any material; None: not looked for yet
        self._foreign: set[Sdf.Path] = set()  # roots of prototypes of PointInstancers
        self._instances = False  # whether there are native ones
        self._expanded = False  # whether the contents of any are part of the root group
        self._cyclic = False
        self._root = Group(Sdf.Path.absoluteRootPath)
        self._nodes: dict[Sdf.Path, Node] | None = None  # of the root group; None: not asked for yet
        self.groups: list[Group] = []
        self.prims_walked = 0

    def _walk(self, group: Group, nodes: list[Node], predicate: Any) -> None:
        stack = nodes[::-1]
        visited = self._recorder.node
        while stack:
            node = stack.pop()
            self._recorder.node = node
            children = self._visit(group, node, predicate)
            if children:
                node.children = [Node(child, child.GetPath(), node) for child in children]
                stack += node.children[::-1]
        self._recorder.node = visited

    def _visit(self, group: Group, node: Node, predicate: Any) -> list[Usd.Prim]:
        """Finds out what a prim puts into the group; its children, as far as they are to be walked."""
        prim = node.prim
        self.prims_walked += 1
        kind_of = self._type(prim)
        kind = node.kind = kind_of.kind
        if kind is Kind.SKIP:
            return []
        assert node.parent is not None and node.parent.state is not None
        inherited = node.parent.state
        authored, clips = self._authored_on(prim, kind, inherited.clips)
        node.authored = authored
        if (authored.visibility or kind_of.asks) and self._is_invisible(prim):
            return []
        matrix, moving = inherited.matrix, inherited.moving
        if not inherited.is_own and (authored.transform or kind_of.asks):
            try:
                local, resets = self._xforms.GetLocalTransformation(prim)
            except Tf.ErrorException:
                why = "nothing of it is rendered: USD cannot read its transform. Check its xformOps' types"
                self._context.reports.error("bad transform", why, node.path)
                return []
            if self._context.shutter is not None:
                moving = inherit(prim, local, resets, matrix, moving, self._context)
            matrix = local if resets or matrix is IDENTITY else local * matrix
        children: list[Usd.Prim] = prim.GetFilteredChildren(predicate)
        is_instance = self._has_prototypes and prim.IsInstance()
        state = self._inherit(node, kind_of, matrix, moving, bool(children) or is_instance, clips)
        if kind_of.model:
            self._check_draw_mode(prim)
        if kind_of.unsupported:
            report_unsupported(prim, prim.GetAppliedSchemas(), self._context)
        if kind is not Kind.CONTAINER:
            self._add(kind_of, group, node, state, children)
        if kind is Kind.INSTANCER:
            return []
        if is_instance and self._add_instance(group, node, state):
            return []
        node.state = state
        return children

    def _type(self, prim: Usd.Prim) -> PrimType:
        name = prim.GetTypeName()
        key = name, tuple(prim.GetAppliedSchemas())
        found = self._types.get(key)
        if found is None:
            found = self._types[key] = prim_type(prim, str(name))
        return found

    def _authored_on(self, prim: Usd.Prim, kind: Kind, clips: bool) -> tuple[Authored, bool]:
        """Names of its properties, and whether it and prims below it may have values from clips.

        clips: whether that is so of its parent.
        """
        names = tuple(prim.GetAuthoredPropertyNames())
        if not clips and (kind is Kind.CONTAINER or "points" not in names):
            clips = bool(prim.HasAuthoredMetadata("clips"))
        if clips:
            names += names_from_clips(prim)
        found = self._authored.get(names)
        if found is None:
            found = self._authored[names] = Authored(str(n) for n in names)
        return found, clips

    def _is_invisible(self, prim: Usd.Prim) -> bool:
        visibility = prim.GetAttribute("visibility")
        return bool(visibility) and visibility.Get(self._context.time) == UsdGeom.Tokens.invisible

    def _inherit(
        self,
        node: Node,
        kind_of: PrimType,
        matrix: Gf.Matrix4d,
        moving: Moving | None,
        passes_on: bool,
        clips: bool,
    ) -> State:
        """passes_on: it has children, or an instance's, that inherit primvars."""
        assert node.parent is not None and node.parent.state is not None and node.authored is not None
        inherited, prim = node.parent.state, node.prim
        purpose, primvars = inherited.purpose, inherited.primvars
        if kind_of.imageable:
            if node.authored.purpose or kind_of.asks:
                imageable = UsdGeom.Imageable(prim)
                purpose = imageable.ComputePurposeInfo(purpose) if purpose else imageable.ComputePurposeInfo()
            elif purpose is None or not purpose.isInheritable:
                purpose = _NO_PURPOSE
        if passes_on and node.authored.primvars:
            primvars = UsdGeom.PrimvarsAPI(prim).FindIncrementallyInheritablePrimvars(primvars) or primvars
        bindings, collections = inherited.bindings, inherited.collections
        if kind_of.binds:
            if passes_on:
                bindings = merge_bindings(prim, bindings)
            collections = collections or node.authored.binds_collections
        return State(
            matrix,
            purpose,
            primvars,
            bindings,
            collections,
            False,
            inherited.rates_root,
            moving,
            inherited.given_root,
            clips,
        )

    def _add(
        self, kind_of: PrimType, group: Group, node: Node, state: State, children: list[Usd.Prim]
    ) -> None:
        kind, prim, reports = kind_of.kind, node.prim, self._context.reports
        if kind is Kind.LIGHT:
            node.items += (LightPrim(prim, to_matrix(state.matrix), state.moving is not None),)
            return
        if kind is Kind.GEOMETRY_LIGHT:
            self._add_geometry_light(node)
            return
        if kind is Kind.UNSUPPORTED_LIGHT:
            name = kind_of.name
            reports.add(f"unsupported {name}", f"{name} is not supported yet, and is not rendered", node.path)
            return
        if kind is Kind.INSTANCER:
            assert node.authored is not None
            if INFLUENCES in node.authored.names:
                message = "joints do not carry PointInstancers yet: its instances are at rest"
                reports.add("skinned instancer", message, node.path)
            self._add_point_instancer(group, node, state)
            return
        if state.purpose.purpose not in self._purposes:
            return
        if kind is Kind.UNSUPPORTED:
            name = kind_of.name
            reports.add(f"unsupported {name}", f"{name} is not supported yet, and is not rendered", node.path)
            return
        subsets = [UsdGeom.Subset(c) for c in children if c.IsA(UsdGeom.Subset)] if children else []
        assert node.authored is not None
        node.items += (
            Rprim(
                prim,
                node.path,
                kind_of.name,
                node.authored,
                to_matrix(state.matrix),
                state.primvars,
                subsets,
                state.moving,
                prim if kind_of.emits else None,
                node.path if group is self._root and not self._expanded else _source(prim),
            ),
        )

    def _add_geometry_light(self, node: Node) -> None:
        prim = node.prim
        relationship = UsdLux.GeometryLight(prim).GetGeometryRel()
        targets = relationship.GetForwardedTargets() if relationship else []
        if not targets:
            self._context.reports.error("bad light", "names no geometry, and does not emit", prim.GetPath())
        node.items += tuple((target, prim) for target in targets)

    def _check_draw_mode(self, prim: Usd.Prim) -> None:
        mode = UsdGeom.ModelAPI(prim).GetModelDrawModeAttr().Get(self._context.time)
        if mode in _DRAW_MODES:
            self._context.reports.add(
                "draw mode",
                f"draw mode {mode} is not supported yet: its full geometry is rendered",
                prim.GetPath(),
            )

    @abstractmethod
    def _add_instance(self, group: Group, node: Node, state: State) -> bool:
        """Places a native instance; False where its contents must be walked as if they were not shared."""

    @abstractmethod
    def _add_point_instancer(self, group: Group, node: Node, state: State) -> None:
        """Places the prototypes of a PointInstancer."""


def _source(prim: Usd.Prim) -> Sdf.Path:
    return prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()


def merge_bindings(prim: Usd.Prim, inherited: Bindings) -> Bindings:
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
