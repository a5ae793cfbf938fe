"""What is on the stage and where: one walk over the prims that are visible and wanted.

The result is a tree of groups. A group holds prims that are placed together: all that is not instanced (the
root), the contents of a native prototype, or one prototype of a PointInstancer. Groups are shared by all
instances that would look the same, so that a prototype is translated once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom

from encore.adapters.context import Matrix, SyncContext, to_matrix
from encore.adapters.primvars import inherited_vary, might_vary
from encore.change_tracker import BINDINGS, PLACE, Changes, DirtyBits
from encore.errors import StageError
from encore.groups import Group, Kind, LightPrim, Node, Placement, Rprim, State
from encore.instancing import DEFINED, InstancingWalk
from encore.report import Reports
from encore.stage_walk import IDENTITY

_OWN_PLACE = (
    DirtyBits.TRANSFORM
    | DirtyBits.VISIBILITY
    | DirtyBits.INSTANCER
    | DirtyBits.INSTANCE_INDEX
    | DirtyBits.EXTENT
    | DirtyBits.POINTS
)
# What moves instances of a PointInstancer besides samples.
_SPEEDS = ("velocities", "accelerations", "angularVelocities")


class Population(InstancingWalk):
    """What is on the stage: found by a walk, and by walking what has changed again."""

    def populate(self, context: SyncContext) -> Group:
        """The root group. All groups are then in `groups`, in the order in which they were met."""
        self._set_context(context)
        self._reset()
        top = self._root.top = Node(self._context.stage.GetPseudoRoot(), Sdf.Path.absoluteRootPath, None)
        top.state = State(IDENTITY, is_own=False)
        prims = self._context.stage.GetPseudoRoot().GetFilteredChildren(DEFINED)
        top.children = [Node(prim, prim.GetPath(), top) for prim in prims]
        self._walk(self._root, top.children, DEFINED)
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
            dirty |= {
                p
                for p, n in found
                if n is None or n.children or n.kind is not Kind.RPRIM or n.prim.IsInstance()
            }
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
        for prim in node.prim.GetFilteredChildren(DEFINED):
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
        self._walk(self._root, fresh, DEFINED)
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


def _transform_might_vary(prim: Usd.Prim) -> bool:
    try:
        return bool(UsdGeom.Xformable(prim).TransformMightBeTimeVarying())
    except Tf.ErrorException:
        return True  # which is reported at every time
