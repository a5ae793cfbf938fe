"""The walk where it meets instances: what they share, and where the groups of that are placed."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from encore.adapters import instance_primvars
from encore.adapters.context import to_matrix
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import product, read_point_instancer
from encore.adapters.material import bound_materials
from encore.adapters.matrix_motion import compose
from encore.adapters.primvars import inherited_signature, read_by_materials
from encore.adapters.shading_rate import is_rate, read_native_rates
from encore.adapters.skin_dependencies import binding_signature
from encore.groups import Bindings, Group, Node, Placement, State
from encore.stage_walk import StageWalk, merge_bindings

DEFINED = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes of PointInstancers are often below an `over`, which hides them elsewhere.
_PROTOTYPES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
_NOTHING_GIVEN: InstancePrimvars = MappingProxyType({})
_NO_PRIMVARS: list[UsdGeom.Primvar] = []  # always this one, so that it is looked at once


class InstancingWalk(StageWalk):
    """Visits instances as well: groups are walked when the first of their instances is met."""

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
        children = [] if key in self._groups else prim.GetFilteredChildren(DEFINED)
        child = self._group(key, prim.GetPath(), uniform, children, state, DEFINED)
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
            for p in Usd.PrimRange(prototype, DEFINED)
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
                bindings = merge_bindings(prim, bindings)
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


def _is_below(prim: Usd.Prim, root: Sdf.Path | None) -> bool:
    return root is None or bool(prim.GetPath().HasPrefix(root))


def _inheritable_purpose(purpose: Any) -> str:
    return str(purpose.purpose) if purpose and purpose.isInheritable else ""


def _has_collection_binding(prim: Usd.Prim) -> bool:
    return any(name.startswith("material:binding:collection") for name in prim.GetAuthoredPropertyNames())
