"""What is on the stage and where: one walk over the prims that are visible and wanted.

The result is a tree of groups. A group holds prims that are placed together: all that is not instanced (the
root), the contents of a native prototype, or one prototype of a PointInstancer. Groups are shared by all
instances that would look the same, so that a prototype is translated once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, UsdSkel, Vt

from encore.adapters import instance_primvars, light
from encore.adapters.authored import Authored, names_from_clips
from encore.adapters.context import Matrix, SyncContext, to_matrix
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import PrototypeScanner, product, read_point_instancer
from encore.adapters.material import bound_materials
from encore.adapters.matrix_motion import Moving, compose, inherit
from encore.adapters.primvars import inherited_signature, inherited_vary, might_vary, read_by_materials
from encore.adapters.shading_rate import is_rate, read_native_rates
from encore.adapters.skin_dependencies import INFLUENCES, binding_signature
from encore.adapters.unsupported import may_be_unsupported, report_unsupported
from encore.change_tracker import BINDINGS, PLACE, Changes, DirtyBits
from encore.errors import StageError
from encore.groups import (
    Bindings,
    Group,
    Kind,
    LightPrim,
    Node,
    Placement,
    PrimType,
    Recorder,
    Rprim,
    State,
)
from encore.readers import reader_of
from encore.report import Reports

_DRAW_MODES = ("origin", "bounds", "cards")
_DEFINED = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes of PointInstancers are often below an `over`, which hides them elsewhere.
_PROTOTYPES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
_OWN_PLACE = (
    DirtyBits.TRANSFORM
    | DirtyBits.VISIBILITY
    | DirtyBits.INSTANCER
    | DirtyBits.INSTANCE_INDEX
    | DirtyBits.EXTENT
    | DirtyBits.POINTS
)
_IDENTITY = Gf.Matrix4d(1)  # what it is multiplied with stays as it is
# What moves instances of a PointInstancer besides samples.
_SPEEDS = ("velocities", "accelerations", "angularVelocities")
_NOTHING_GIVEN: InstancePrimvars = MappingProxyType({})
_NO_PRIMVARS: list[UsdGeom.Primvar] = []  # always this one, so that it is looked at once
_NO_PURPOSE = UsdGeom.Imageable.PurposeInfo(UsdGeom.Tokens.default_, False)


class Population:
    """Walks the stage. purposes: of the prims that are wanted. material_purposes: of bindings, in order."""

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

    def populate(self, context: SyncContext) -> Group:
        """The root group. All groups are then in `groups`, in the order in which they were met."""
        self._set_context(context)
        self._reset()
        top = self._root.top = Node(self._context.stage.GetPseudoRoot(), Sdf.Path.absoluteRootPath, None)
        top.state = State(_IDENTITY, is_own=False)
        prims = self._context.stage.GetPseudoRoot().GetFilteredChildren(_DEFINED)
        top.children = [Node(prim, prim.GetPath(), top) for prim in prims]
        self._walk(self._root, top.children, _DEFINED)
        self._collect(context.reports)
        return self._root

    def update(self, context: SyncContext, changes: Changes, other_time: bool) -> Group:
        """The root group after changes, and at another time: as populate() would find it.

        Prims that changed are walked again with all below them, where they are in the root group; what is
        instanced is, as a whole. other_time: since the last walk, time or shutter are others.
        """
        self.prims_walked = 0
        self._set_context(context)
        for known in (self._signatures, self._split, self._given):
            known.clear()
        dirty = self._dirty(changes, other_time)
        if (
            dirty is None
            or not self._walk_again(dirty, changes.resynced)
            or not self._collect(context.reports)
        ):
            return self.populate(context)
        return self._root

    def _dirty(self, changes: Changes, other_time: bool) -> set[Sdf.Path] | None:
        """Prims that are to be walked again; None: all of them."""
        if self._root.top is None or self._cyclic:
            return None
        dirty = changes.resynced | changes.renamed | changes.having(PLACE)
        # Subsets belong to what they are below.
        for path in changes.resynced:
            parent = self._known_nodes().get(path.GetParentPath())
            if parent is not None and parent.kind is Kind.RPRIM:
                dirty.add(parent.path)
        passing = changes.having(DirtyBits.PRIMVAR | BINDINGS)
        if passing:
            nodes = self._known_nodes()
            found = ((path, nodes.get(path)) for path in passing)
            dirty |= {p for p, n in found if n is None or n.children or n.kind is not Kind.RPRIM}
        if self._instances and (changes.resynced or changes.bits & BINDINGS):
            return None
        known = self._read_primvars
        if known is not None and changes.bits & DirtyBits.PARAMS and self._names_that_are_read() != known:
            return None
        if any(Usd.Prim.IsPathInPrototype(path) for path in dirty):
            return None
        # What is above a prototype's root passes on all but where it is itself.
        passing_on = changes.resynced | changes.renamed | changes.having(~_OWN_PLACE)
        if any(p.HasPrefix(r) or (p in passing_on and r.HasPrefix(p)) for r in self._foreign for p in dirty):
            return None
        if other_time:
            for group in self.groups:
                varying = self._varying(group)
                if varying and group is not self._root:
                    return None
                dirty |= varying
        return dirty

    def _varying(self, group: Group) -> set[Sdf.Path]:
        """Prims that may be elsewhere, or not be there, at another time; none below another one of them."""
        found = set()
        assert group.top is not None
        stack = group.top.children[::-1]
        while stack:
            node = stack.pop()
            if not node.prim:
                continue  # gone, as changes say
            if node.varies is None:
                node.varies = self._might_vary(node)
            if node.varies:
                found.add(node.path)
            else:
                stack += node.children
        return found

    def _might_vary(self, node: Node) -> bool:
        prim, authored = node.prim, node.authored
        if authored is None:
            return False
        if authored.visibility and prim.GetAttribute("visibility").ValueMightBeTimeVarying():
            return True
        if authored.transform and _transform_might_vary(prim):
            return True
        if node.kind is Kind.INSTANCER:
            # Its own primvars and positions, and where prototypes are in their own space.
            roots = (self._context.stage.GetPrimAtPath(path) for path in self._foreign)
            return (
                not authored.names.isdisjoint(_SPEEDS)
                or might_vary(prim)
                or any(_transform_might_vary(r) for r in roots if r)
                or inherited_vary(prim)
            )
        return bool(prim.IsInstance()) and (might_vary(prim) or inherited_vary(prim))

    def _known_nodes(self) -> dict[Sdf.Path, Node]:
        """Of the root group, by path."""
        if self._nodes is None:
            self._nodes = {}
            assert self._root.top is not None
            self._note_nodes([self._root.top])
        return self._nodes

    def _note_nodes(self, nodes: list[Node]) -> None:
        assert self._nodes is not None
        stack = list(nodes)
        while stack:
            node = stack.pop()
            self._nodes[node.path] = node
            stack += node.children

    def _forget_nodes(self, node: Node) -> None:
        assert self._nodes is not None
        stack = [node]
        while stack:
            gone = stack.pop()
            self._nodes.pop(gone.path, None)
            stack += gone.children

    def _walk_again(self, dirty: set[Sdf.Path], resynced: set[Sdf.Path]) -> bool:
        """Replaces the walks of dirty prims; False where that cannot be done prim by prim."""
        if not dirty:
            return True
        nodes = self._known_nodes()
        replaced: set[Sdf.Path] = set()
        children_of: dict[Sdf.Path, set[Sdf.Path]] = {}  # dirty ones of prims that stay
        for path in sorted(dirty):
            if path.IsAbsoluteRootPath():
                return False
            above = path if path in nodes and path not in resynced else path.GetParentPath()
            below = path
            while above not in nodes:
                above, below = above.GetParentPath(), above
            if above == path:
                replaced.add(path)
            elif nodes[above].state is not None:
                children_of.setdefault(above, set()).add(below)
            elif not above.IsAbsoluteRootPath():
                replaced.add(above)
        for path in replaced:
            children_of.setdefault(nodes[path].parent.path, set()).add(path)  # type: ignore[union-attr]
        done: set[Sdf.Path] = set()
        for path in sorted(children_of):
            if not any(prefix in done for prefix in path.GetPrefixes()):
                done |= self._walk_children(nodes[path], children_of[path])
        return True

    def _walk_children(self, node: Node, dirty: set[Sdf.Path]) -> set[Sdf.Path]:
        """Walks those children of a prim that are dirty, or new; their paths, and of those that are gone."""
        known = {child.path: child for child in node.children}
        children, fresh = [], []
        for prim in node.prim.GetFilteredChildren(_DEFINED):
            path = prim.GetPath()
            child = known.pop(path, None)
            if child is None or path in dirty:
                if child is not None:
                    self._forget_nodes(child)
                child = Node(prim, path, node)
                fresh.append(child)
            children.append(child)
        for gone in known.values():
            self._forget_nodes(gone)
        node.children = children
        self._walk(self._root, fresh, _DEFINED)
        self._note_nodes(fresh)
        return {child.path for child in fresh} | known.keys()

    @property
    def depth(self) -> int:
        """Of the deepest prim below the root."""
        deepest = 0
        for group in self.groups:
            assert group.top is not None
            stack = list(group.top.children)
            while stack:
                node = stack.pop()
                deepest = max(deepest, node.path.pathElementCount)
                stack += node.children
        return deepest

    def world_matrix(self, prim: Usd.Prim) -> Matrix:
        """Local to world at the context's time. Raises StageError where USD cannot read it."""
        try:
            return to_matrix(self._xforms.GetLocalToWorldTransform(prim))
        except Tf.ErrorException as error:
            what = "its transform cannot be read"
            raise StageError(what, str(prim.GetPath()), "Check the types of its xformOps") from error

    def _collect(self, reports: Reports) -> bool:
        """Gathers what the walks have found, and their reports, in the order of a walk from the start.

        False, and no reports, where groups would have been met in another order.
        """
        self.groups = []
        geometry_lights: list[tuple[Sdf.Path, Usd.Prim]] = []
        seen: dict[Any, Group] = {}
        log: list[Any] = []

        def gather(group: Group) -> bool:
            seen[group.key] = group
            self.groups.append(group)
            group.rprims, group.lights, group.children = [], [], []
            assert group.top is not None
            stack = group.top.children[::-1]
            while stack:
                node = stack.pop()
                for item in node.log or ():
                    if not isinstance(item, Group):
                        log.append(item)
                    elif item.key not in seen:
                        in_order = item.path in (node.path, item.root) and gather(item)
                        if not in_order:
                            return False
                for item in node.items:
                    if isinstance(item, Rprim):
                        group.rprims.append(item)
                    elif isinstance(item, Placement):
                        group.children.append(item)
                    elif isinstance(item, LightPrim):
                        group.lights.append(item)
                    else:
                        geometry_lights.append(item)
                stack += node.children[::-1]
            return True

        if not gather(self._root):
            return False
        self._groups = {key: group for key, group in seen.items() if key is not None}
        reports.replay(tuple(log))
        self._assign_geometry_lights(dict(geometry_lights), reports)
        return True

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
            matrix = local if resets or matrix is _IDENTITY else local * matrix
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
            found = self._types[key] = _type_of(prim, str(name))
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
                bindings = _merge_bindings(prim, bindings)
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

    def _assign_geometry_lights(self, waiting: dict[Sdf.Path, Usd.Prim], reports: Reports) -> None:
        """Makes what GeometryLights name emit. waiting: by what emits."""
        if not waiting:
            return
        for group in self.groups:
            for i, rprim in enumerate(group.rprims):
                light_prim = waiting.pop(rprim.path, None)
                if light_prim is not None:
                    group.rprims[i] = replace(rprim, light=light_prim)
        for target, light_prim in waiting.items():
            reports.add(
                "GeometryLight without geometry",
                f"does not emit: its geometry {target} is not rendered",
                light_prim.GetPath(),
            )

    def _check_draw_mode(self, prim: Usd.Prim) -> None:
        mode = UsdGeom.ModelAPI(prim).GetModelDrawModeAttr().Get(self._context.time)
        if mode in _DRAW_MODES:
            self._context.reports.add(
                "draw mode",
                f"draw mode {mode} is not supported yet: its full geometry is rendered",
                prim.GetPath(),
            )

    # Instancing

    def _add_instance(self, group: Group, node: Node, state: State) -> bool:
        """Places a native instance; False where its contents must be walked as if they were not shared."""
        prim = node.prim
        self._instances = True
        prototype = prim.GetPrototype()
        traits = self._scanner.traits(prototype)
        if traits.resets:
            self._expanded = True
            return False
        uniform = not traits.binds and not state.collections
        rate_primvars, others = self._split_rates(state.primvars)
        rates, own_rates = read_native_rates(prim, rate_primvars, self._context)
        if traits.rates:
            rates = own_rates
        else:
            state = replace(state, primvars=others, rates_root=prim.GetPath())
        given, others = self._split_given(state.primvars)
        state = replace(state, primvars=others, given_root=prim.GetPath())
        key = (
            prototype.GetPath(),
            _inheritable_purpose(state.purpose),
            self._primvar_signature(state.primvars),
            None if uniform else self._binding_signature(prim, prototype, state),
            binding_signature(prim, self._context.time) if traits.skins else None,
        )
        children = [] if key in self._groups else prim.GetFilteredChildren(_DEFINED)
        child = self._group(key, prim.GetPath(), uniform, children, state, _DEFINED)
        if child is not None:
            bound = prim if uniform and not group.uniform else None
            matrices = to_matrix(state.matrix)[None]
            instance_rates = np.array([rates], np.float32) if any(rates) else None
            keys = state.moving.keys() if state.moving else None
            node.items += (
                Placement(
                    child,
                    matrices,
                    str(prim.GetPath()),
                    None,
                    bound,
                    instance_rates,
                    keys,
                    given,
                ),
            )
        return True

    def _binding_signature(self, prim: Usd.Prim, prototype: Usd.Prim, state: State) -> object:
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

    def _add_point_instancer(self, group: Group, node: Node, state: State) -> None:
        prim = node.prim
        matrix = to_matrix(state.matrix)
        keys = state.moving.keys() if state.moving else None
        for placements in read_point_instancer(
            UsdGeom.PointInstancer(prim), self._read_names(), self._context
        ):
            root = placements.root
            self._foreign.add(root.GetPath())
            inherited = self._state_above(root, state)
            key = (root.GetPath(), _inheritable_purpose(inherited.purpose), group.uniform)
            child = self._group(key, root.GetPath(), group.uniform, [root], inherited, _PROTOTYPES)
            if child is not None:
                node.items += (
                    Placement(
                        child,
                        product(placements.matrices, matrix),
                        str(prim.GetPath()),
                        placements.ids,
                        rates=placements.rates,
                        motion=compose(placements.matrices, placements.motion, matrix[None], keys),
                        primvars=placements.primvars,
                        inherits=_is_below(root, state.given_root),
                    ),
                )

    def _state_above(self, root: Usd.Prim, instancer: State) -> State:
        """What the root of a PointInstancer's prototype inherits: from its ancestors, wherever it is.

        Its own transform is part of the instancer's matrices, and a purpose may come from the instancer.
        """
        parent = root.GetParent()
        bindings: Bindings = ()
        collections = clips = False
        for path in parent.GetPath().GetPrefixes():
            prim = self._context.stage.GetPrimAtPath(path)
            clips = clips or bool(prim.HasAuthoredMetadata("clips"))
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
        given_root = instancer.given_root
        if given_root is not None and _is_below(root, given_root):
            given, root_of = self._split_given(primvars)[0], instance_primvars.authored_above
            primvars = [
                p for p in primvars if str(p.GetPrimvarName()) not in given or not root_of(p, given_root)
            ]
        else:
            given_root = None
        return State(
            Gf.Matrix4d(1),
            purpose,
            primvars,
            bindings,
            collections,
            is_own=True,
            rates_root=outside,
            given_root=given_root,
            clips=clips,
        )

    def _group(
        self,
        key: Any,
        path: Sdf.Path,
        uniform: bool,
        prims: list[Usd.Prim],
        state: State,
        predicate: Any,
    ) -> Group | None:
        """The group of the key, walked when first asked for; None, and a report, for one inside of itself."""
        if key in self._open:
            self._cyclic = True
            self._context.reports.error(
                "instancing cycle", "is a prototype of itself, and is not rendered", path
            )
            return None
        group = self._groups.get(key)
        if group is None:
            root = path if predicate is _PROTOTYPES else None
            group = self._groups[key] = Group(path, uniform, key=key, root=root)
            top = group.top = Node(None, path, None)
            top.state = replace(state, matrix=Gf.Matrix4d(1), moving=None)
            top.children = [Node(prim, prim.GetPath(), top) for prim in prims]
            self._recorder.note_item(group)
            self._open.append(key)
            self._walk(group, top.children, predicate)
            self._open.pop()
        else:
            self._recorder.note_item(group)
        return group

    def _primvar_signature(self, primvars: list[UsdGeom.Primvar]) -> tuple[object, ...]:
        known = self._signatures.get(id(primvars))
        if known is None:
            # The list is kept, so that its id stays its own.
            known = self._signatures[id(primvars)] = (
                primvars,
                inherited_signature(primvars, self._context.time, self._read_names() if primvars else ()),
            )
        return known[1]

    def _read_names(self) -> frozenset[str]:
        """Names of primvars that materials read, or images show."""
        if self._read_primvars is None:
            self._read_primvars = self._names_that_are_read()
        return self._read_primvars

    def _names_that_are_read(self) -> frozenset[str]:
        return read_by_materials(self._context.stage, self._context.time) | self.aov_primvars

    def _split_given(self, primvars: list[UsdGeom.Primvar]) -> tuple[InstancePrimvars, list[UsdGeom.Primvar]]:
        """What instances give to what is placed, and the rest; always the same lists for the same list."""
        if not primvars:
            return _NOTHING_GIVEN, primvars
        known = self._given.get(id(primvars))
        if known is None:
            given: dict[str, instance_primvars.InstanceValues] = {}
            rest = []
            for primvar in primvars:
                value = instance_primvars.inherited_value(primvar, self._read_names(), self._context.time)
                if value is None:
                    rest.append(primvar)
                else:
                    given[str(primvar.GetPrimvarName())] = value
            rest = primvars if not given else rest or _NO_PRIMVARS
            known = self._given[id(primvars)] = (primvars, given, rest)
        return known[1:]

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


def _transform_might_vary(prim: Usd.Prim) -> bool:
    try:
        return bool(UsdGeom.Xformable(prim).TransformMightBeTimeVarying())
    except Tf.ErrorException:
        return True  # which is reported at every time


def _source(prim: Usd.Prim) -> Sdf.Path:
    return prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()


def _is_below(prim: Usd.Prim, root: Sdf.Path | None) -> bool:
    return root is None or bool(prim.GetPath().HasPrefix(root))


def _inheritable_purpose(purpose: Any) -> str:
    return str(purpose.purpose) if purpose and purpose.isInheritable else ""


def _merge_bindings(prim: Usd.Prim, inherited: Bindings) -> Bindings:
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


def _type_of(prim: Usd.Prim, name: str) -> PrimType:
    definition = prim.GetPrimDefinition()
    asks = any(definition.GetAttributeFallbackValue(n) not in (None, v) for n, v in _FALLBACKS.items())
    return PrimType(
        name,
        _kind_of(prim, name),
        prim.IsA(UsdGeom.Imageable),
        prim.HasAPI(UsdShade.MaterialBindingAPI),
        prim.HasAPI(UsdLux.LightAPI),
        prim.HasAPI(UsdGeom.ModelAPI),
        asks,
        may_be_unsupported(prim.GetAppliedSchemas()),
    )


# What UsdGeomImageable and UsdGeomXformable have where nothing is authored.
_FALLBACKS: Mapping[str, Any] = {
    "visibility": UsdGeom.Tokens.inherited,
    "purpose": UsdGeom.Tokens.default_,
    "xformOpOrder": Vt.TokenArray(),
}


_LIGHT_BASES = (UsdLux.BoundableLightBase, UsdLux.NonboundableLightBase, UsdLux.LightFilter)
_OTHER_LIGHTS = frozenset({"PluginLight"})


def _kind_of(prim: Usd.Prim, name: str) -> Kind:
    if reader_of(prim, name) is not None:
        return Kind.RPRIM
    if prim.IsA(UsdGeom.PointInstancer):
        return Kind.INSTANCER
    if name in light.TYPES:
        return Kind.LIGHT
    if name == "GeometryLight":
        return Kind.GEOMETRY_LIGHT
    if name in _OTHER_LIGHTS or any(prim.IsA(base) for base in _LIGHT_BASES):
        return Kind.UNSUPPORTED_LIGHT
    if prim.IsA(UsdGeom.Subset) or prim.IsA(UsdShade.NodeGraph) or prim.IsA(UsdShade.Shader):
        return Kind.SKIP
    if prim.IsA(UsdGeom.Boundable) and not (prim.IsA(UsdSkel.Root) or prim.IsA(UsdSkel.Skeleton)):
        return Kind.UNSUPPORTED
    return Kind.CONTAINER
