"""What has changed on a stage since it was last translated, as Hydra's change tracker has it.

Fed from Usd.Notice.ObjectsChanged. Changes of the time come from encore.render_index, which knows what may
vary.
"""

from __future__ import annotations

import enum
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field

from pxr import Sdf, Tf, Usd


class DirtyBits(enum.Flag):
    """Of rprims, instancers and sprims, by Hydra's names."""

    CLEAN = 0
    TRANSFORM = enum.auto()
    VISIBILITY = enum.auto()
    RENDER_TAG = enum.auto()  # purpose
    EXTENT = enum.auto()
    POINTS = enum.auto()  # and what moves them: velocities, accelerations
    TOPOLOGY = enum.auto()
    NORMALS = enum.auto()
    WIDTHS = enum.auto()
    PRIMVAR = enum.auto()
    MATERIAL_ID = enum.auto()  # bindings
    DOUBLE_SIDED = enum.auto()
    SUBDIV_TAGS = enum.auto()
    INSTANCER = enum.auto()  # transforms of instances
    INSTANCE_INDEX = enum.auto()  # which instances there are, and of what
    CATEGORIES = enum.auto()  # collections: linking, and bindings by collection
    PARAMS = enum.auto()  # of materials, lights and cameras
    RESOURCE = enum.auto()  # files
    # What nothing is known of, and prims that come, go, or change their composition.
    ALL = (
        TRANSFORM | VISIBILITY | RENDER_TAG | EXTENT | POINTS | TOPOLOGY | NORMALS | WIDTHS | PRIMVAR
        | MATERIAL_ID | DOUBLE_SIDED | SUBDIV_TAGS | INSTANCER | INSTANCE_INDEX | CATEGORIES | PARAMS
        | RESOURCE
    )  # fmt: skip


# What decides which prims there are and where.
PLACE = (
    DirtyBits.TRANSFORM
    | DirtyBits.VISIBILITY
    | DirtyBits.RENDER_TAG
    | DirtyBits.INSTANCER
    | DirtyBits.INSTANCE_INDEX
)
# What decides the mesh of an rprim.
GEOMETRY = (
    DirtyBits.POINTS
    | DirtyBits.TOPOLOGY
    | DirtyBits.NORMALS
    | DirtyBits.WIDTHS
    | DirtyBits.PRIMVAR
    | DirtyBits.DOUBLE_SIDED
    | DirtyBits.SUBDIV_TAGS
)
BINDINGS = DirtyBits.MATERIAL_ID | DirtyBits.CATEGORIES

_NAMES: dict[str, DirtyBits] = {
    "visibility": DirtyBits.VISIBILITY,
    "purpose": DirtyBits.RENDER_TAG,
    "xformOpOrder": DirtyBits.TRANSFORM,
    "extent": DirtyBits.EXTENT,
    "extentsHint": DirtyBits.EXTENT,
    "points": DirtyBits.POINTS,
    "velocities": DirtyBits.POINTS | DirtyBits.INSTANCER,
    "accelerations": DirtyBits.POINTS | DirtyBits.INSTANCER,
    "faceVertexCounts": DirtyBits.TOPOLOGY,
    "faceVertexIndices": DirtyBits.TOPOLOGY,
    "holeIndices": DirtyBits.TOPOLOGY,
    "curveVertexCounts": DirtyBits.TOPOLOGY,
    "subdivisionScheme": DirtyBits.TOPOLOGY,
    "orientation": DirtyBits.TOPOLOGY,
    "doubleSided": DirtyBits.DOUBLE_SIDED,
    "normals": DirtyBits.NORMALS,
    "widths": DirtyBits.WIDTHS,
    "cornerIndices": DirtyBits.SUBDIV_TAGS,
    "cornerSharpnesses": DirtyBits.SUBDIV_TAGS,
    "creaseIndices": DirtyBits.SUBDIV_TAGS,
    "creaseLengths": DirtyBits.SUBDIV_TAGS,
    "creaseSharpnesses": DirtyBits.SUBDIV_TAGS,
    "interpolateBoundary": DirtyBits.SUBDIV_TAGS,
    "faceVaryingLinearInterpolation": DirtyBits.SUBDIV_TAGS,
    "triangleSubdivisionRule": DirtyBits.SUBDIV_TAGS,
    "positions": DirtyBits.INSTANCER,
    "orientations": DirtyBits.INSTANCER,
    "orientationsf": DirtyBits.INSTANCER,
    "scales": DirtyBits.INSTANCER,
    "angularVelocities": DirtyBits.INSTANCER,
    "protoIndices": DirtyBits.INSTANCE_INDEX,
    "prototypes": DirtyBits.INSTANCE_INDEX,
    "ids": DirtyBits.INSTANCE_INDEX,
    "invisibleIds": DirtyBits.INSTANCE_INDEX,
}
_NAMES |= dict.fromkeys(
    # Of implicit shapes, curves and subsets.
    ("size", "radius", "radiusTop", "radiusBottom", "height", "width", "length", "axis", "basis", "type",
     "wrap", "indices", "familyName", "elementType"),
    DirtyBits.TOPOLOGY,
)  # fmt: skip
_NAMES |= dict.fromkeys(
    # Of cameras.
    ("focalLength", "focusDistance", "fStop", "horizontalAperture", "verticalAperture",
     "horizontalApertureOffset", "verticalApertureOffset", "projection", "clippingRange", "clippingPlanes",
     "shutter:open", "shutter:close", "exposure", "stereoRole"),
    DirtyBits.PARAMS,
)  # fmt: skip
_PREFIXES: Mapping[str, DirtyBits] = {
    "xformOp:": DirtyBits.TRANSFORM,
    "primvars:": DirtyBits.PRIMVAR,
    "material:binding": BINDINGS,
    "collection:": DirtyBits.CATEGORIES,
    "inputs:": DirtyBits.PARAMS,
    "outputs:": DirtyBits.PARAMS,
    "info:": DirtyBits.PARAMS,
}


def dirty_bits(name: str) -> DirtyBits:
    """What is dirty when a property of this name has changed."""
    known = _NAMES.get(name)
    if known is not None:
        return known
    return next((bits for prefix, bits in _PREFIXES.items() if name.startswith(prefix)), DirtyBits.ALL)


@dataclass
class Changes:
    """What has changed. prims: by path, for changed properties.

    resynced: prims that have come, gone, or changed their composition, with all below them. renamed: prims of
    which properties have come or gone, or changed what they are. files: prims whose assets resolve to others.
    everything: nothing that was known is to be relied on.
    """

    prims: dict[Sdf.Path, DirtyBits] = field(default_factory=dict)
    resynced: set[Sdf.Path] = field(default_factory=set)
    renamed: set[Sdf.Path] = field(default_factory=set)
    everything: bool = False

    def __bool__(self) -> bool:
        return bool(self.everything or self.prims or self.resynced)

    @property
    def bits(self) -> DirtyBits:
        """Of all prims together."""
        found = DirtyBits.ALL if self.everything or self.resynced else DirtyBits.CLEAN
        for bits in self.prims.values():
            found |= bits
        return found

    def having(self, bits: DirtyBits) -> set[Sdf.Path]:
        """Prims of which any of these bits is dirty; resynced ones are not among them."""
        return {path for path, found in self.prims.items() if found & bits}


class ChangeTracker:
    """Listens to a stage. It is to be kept while its changes are wanted: it does not keep itself."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._changes = Changes(everything=True)
        this = weakref.ref(self)

        def changed(notice: Usd.Notice.ObjectsChanged, sender: Usd.Stage) -> None:
            tracker = this()
            if tracker is not None:
                tracker._note(notice)

        self._callback = changed  # USD itself does not keep it
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, changed, stage)

    @property
    def changes(self) -> Changes:
        """What has changed since take(); all has before the first one. Not to be written to."""
        return self._changes

    def take(self) -> Changes:
        """What has changed since the last time; from then on, all is clean."""
        changes, self._changes = self._changes, Changes()
        return changes

    def mark_all_dirty(self) -> None:
        """As if nothing were known of the stage."""
        self._changes.everything = True

    def mark_dirty(self, path: Sdf.Path, bits: DirtyBits) -> None:
        """Makes bits of a prim dirty."""
        prims = self._changes.prims
        prims[path] = prims.get(path, DirtyBits.CLEAN) | bits

    def dirty_bits(self, path: Sdf.Path) -> DirtyBits:
        """Of a prim, since take()."""
        if self._changes.everything or any(path.HasPrefix(r) for r in self._changes.resynced):
            return DirtyBits.ALL
        return self._changes.prims.get(path, DirtyBits.CLEAN)

    def close(self) -> None:
        """Stops listening."""
        self._listener.Revoke()

    def _note(self, notice: Usd.Notice.ObjectsChanged) -> None:
        for path in notice.GetResyncedPaths():
            self._resync(path)
        if hasattr(notice, "GetResolvedAssetPathsResyncedPaths"):
            for path in notice.GetResolvedAssetPathsResyncedPaths():
                self._resync(path)
        for path in notice.GetChangedInfoOnlyPaths():
            if path.IsPropertyPath():
                self.mark_dirty(path.GetPrimPath(), dirty_bits(path.name))
                if not _VALUES.issuperset(notice.GetChangedFields(path)):
                    self._changes.renamed.add(path.GetPrimPath())
            elif path.IsAbsoluteRootPath():
                if not _HARMLESS.issuperset(notice.GetChangedFields(path)):
                    self.mark_all_dirty()
            elif not _HARMLESS.issuperset(notice.GetChangedFields(path)):
                self._resync(path)

    def _resync(self, path: Sdf.Path) -> None:
        if path.IsAbsoluteRootPath():
            self.mark_all_dirty()
        elif path.IsPropertyPath():
            self.mark_dirty(path.GetPrimPath(), dirty_bits(path.name))
            self._changes.renamed.add(path.GetPrimPath())
        else:
            self._changes.resynced.add(path.GetPrimPath())


# Fields of properties whose change leaves the property what it is.
_VALUES = frozenset(("default", "timeSamples", "spline", "targetPaths", "connectionPaths", "customData"))
# Fields of prims and layers that nothing is read from.
_HARMLESS = frozenset(
    ("comment", "documentation", "customData", "assetInfo", "displayName", "userDocumentation",
     "customLayerData", "startTimeCode", "endTimeCode", "hidden")
)  # fmt: skip
