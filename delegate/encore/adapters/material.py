"""UsdShade materials → UsdPreviewSurface or GLSL surfaces, with their networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pxr import Sdf, Usd, UsdShade

from encore.adapters import glsl
from encore.adapters.context import SyncContext, floats
from encore.adapters.network import Input, Network
from encore.adapters.texture import Textures
from encore.report import Reports

# On the material prim: where transparent solids overlap, the one of higher priority is there.
DIELECTRIC_PRIORITY = "inputs:encore:dielectricPriority"

# Of terminals: outputs of this render context win over the universal ones.
RENDER_CONTEXT = "encore"
# Input of UsdPreviewSurface → key of _core.Scene.add_material, and default (UsdPreviewSurface 2.6). occlusion
# is left out: the specification leaves it to renderers that do not compute occlusion themselves.
_COLOURS = {
    "diffuseColor": ("diffuse_color", (0.18, 0.18, 0.18)),
    "emissiveColor": ("emissive_color", (0.0, 0.0, 0.0)),
    "specularColor": ("specular_color", (0.0, 0.0, 0.0)),
}
_NUMBERS = {
    "metallic": ("metallic", 0.0),
    "roughness": ("roughness", 0.5),
    "clearcoat": ("clearcoat", 0.0),
    "clearcoatRoughness": ("clearcoat_roughness", 0.01),
    "opacity": ("opacity", 1.0),
    "ior": ("ior", 1.5),
}
_UP = (0.0, 0.0, 1.0)
# What GLSL is given without asking, and what normals that are no texture are given in the tangents of.
_GLSL_TEXCOORD = "st"
_OPACITY_MODES = ("transparent", "presence")


@dataclass(frozen=True)
class MaterialData:
    """One material as _core.Scene.add_material takes it. cut_out: nothing that it is bound to is visible.

    primvars: floats that it reads of each one by name. tangents: normals are given in those of st. optional:
    texture coordinates and primvars that a mesh may lack without a report.
    """

    path: str
    inputs: dict[str, Any] = field(default_factory=dict)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    use_specular_workflow: bool = False
    opacity_threshold: float = 0.0
    opacity_mode: str = "transparent"
    dielectric_priority: int = 0
    surface_shader: dict[str, Any] | None = None
    displacement_shader: dict[str, Any] | None = None
    primvars: Mapping[str, int] = field(default_factory=dict)
    tangents: bool = False
    optional: frozenset[str] = frozenset()
    cut_out: bool = False

    @cached_property
    def texcoords(self) -> frozenset[str]:
        """Names of the texture coordinates that it reads."""
        textures = (n for n in self.nodes if n["kind"] == "texture" and n["texture"] >= 0)
        names = frozenset(n["texcoord"] for n in textures if n["texcoord"])
        return names | {_GLSL_TEXCOORD} if self.tangents or self._has_glsl else names

    @cached_property
    def _has_glsl(self) -> bool:
        return bool(self.surface_shader or self.displacement_shader)

    @cached_property
    def reads_color(self) -> bool:
        """True where it reads displayColor per element."""
        return self._has_glsl or any(n["kind"] == "displayColor" for n in self.nodes)

    @cached_property
    def reads(self) -> dict[str, int]:
        """Floats that it reads of each primvar, texture coordinates and displayColor among them."""
        found = dict(self.primvars)
        if self.reads_color:
            found["displayColor"] = max(3, found.get("displayColor", 0))
        for name in self.texcoords:
            found[name] = max(2, found.get(name, 0))
        return found

    @cached_property
    def displacement_reads(self) -> frozenset[str]:
        """Names of the primvars that its displacement reads, or may read where it is GLSL."""
        inputs = [self.inputs.get("displacement")]
        names = set[str]()
        if self.displacement_shader:
            inputs += [p["input"] for p in self.displacement_shader["parameters"]]
            names |= {_GLSL_TEXCOORD, "displayColor"}
        for found in inputs:
            if isinstance(found, dict) and found["node"] >= 0:
                node = self.nodes[found["node"]]
                names.add(node["kind"] if node["kind"] == "displayColor" else _name_read(node))
        return frozenset(names)

    @cached_property
    def transmits(self) -> bool:
        """True where light may pass the surface and be bent: it matters whether meshes are solids."""
        if self.surface_shader:
            return True
        if self.opacity_threshold > 0 or self.opacity_mode != "transparent":
            return False
        opacity = self.inputs.get("opacity", 1.0)
        return isinstance(opacity, dict) or opacity < 1

    @cached_property
    def displaces(self) -> bool:
        """True where it moves the points of meshes."""
        displacement = self.inputs.get("displacement", 0.0)
        return bool(self.displacement_shader or isinstance(displacement, dict) or displacement)

    @cached_property
    def reads_files(self) -> bool:
        """True where it has GLSL from files."""
        shaders = (self.surface_shader, self.displacement_shader)
        return any(s is not None and not s["file"].startswith(s["path"] + ".") for s in shaders)

    def arguments(self, textures: Mapping[int, int]) -> dict[str, Any]:
        """Keyword arguments of _core.Scene.add_material. textures: the scene's, by those of Textures."""
        return {
            "path": self.path,
            "inputs": self.inputs,
            "nodes": [_in_scene(n, textures) for n in self.nodes] if textures else self.nodes,
            "use_specular_workflow": self.use_specular_workflow,
            "opacity_threshold": self.opacity_threshold,
            "opacity_mode": self.opacity_mode,
            "dielectric_priority": self.dielectric_priority,
            "surface_shader": self.surface_shader,
            "displacement_shader": self.displacement_shader,
        }


def _in_scene(node: dict[str, Any], textures: Mapping[int, int]) -> dict[str, Any]:
    """A node with the scene's textures."""
    found = node
    if node.get("texture", -1) >= 0:
        found = found | {"texture": textures[node["texture"]]}
    if node.get("udim"):
        found = found | {"udim": [textures[t] if t >= 0 else -1 for t in node["udim"]]}
    return found


_OPACITY = "displayOpacity"
# Of meshes without a material: matte, and without an interface that reflects.
_MATTE = {"ior": 1.0, "roughness": 1.0}


GREY = (0.18, 0.18, 0.18)


def default_material() -> MaterialData:
    """For what has neither material nor displayColor."""
    return MaterialData("default", {"diffuse_color": GREY, **_MATTE})


def display_material(color: tuple[float, ...] | None, opacity: float | None) -> MaterialData:
    """For what has no material: displayColor, and displayOpacity as presence. None: it varies."""
    inputs: dict[str, Any] = {"diffuse_color": color, **_MATTE}
    nodes: list[dict[str, Any]] = []
    name = "displayColor" if color is None else f"displayColor({', '.join(f'{c:.6g}' for c in color)})"
    if color is None:
        inputs["diffuse_color"] = {"value": GREY, "node": 0, "channel": 0}
        nodes.append({"kind": "displayColor", "path": "displayColor"})
    if opacity == 1:
        return MaterialData(name, inputs, nodes)
    name += " displayOpacity" if opacity is None else f" displayOpacity({opacity:.6g})"
    inputs["opacity"] = opacity
    if opacity is None:
        inputs["opacity"] = {"value": 1.0, "node": len(nodes), "channel": 0}
        fallback = (1.0, 0.0, 0.0, 0.0)
        nodes.append({"kind": "primvar", "path": _OPACITY, "primvar": _OPACITY, "fallback": fallback})
    reads = {_OPACITY: 1} if opacity is None else {}
    return MaterialData(
        name,
        inputs,
        nodes,
        opacity_mode="presence",
        primvars=reads,
        optional=frozenset(reads),
        cut_out=opacity == 0,
    )


def read_material(
    material: UsdShade.Material, textures: Textures, context: SyncContext
) -> MaterialData | None:
    """The material; None, and a report, where it has no surface that is supported."""
    shader = _terminal(material, "surface")
    path = material.GetPath()
    volume = material.GetVolumeOutput()
    if volume and volume.HasConnectedSource():
        context.reports.add("volume shader", "volumes are not supported: nothing fills its inside", path)
    if not shader:
        contexts = sorted({o.GetBaseName() for o in material.GetOutputs()}) or ["none"]
        context.reports.add(
            "no UsdPreviewSurface",
            f"has no universal surface (outputs: {', '.join(contexts)}): displayColor is used instead",
            path,
        )
        return None
    network = Network(str(path), textures, context)
    if glsl.is_glsl(shader):
        return _Reader(material, shader, network, context).glsl_surface()
    identifier = shader.GetShaderId()
    if identifier != "UsdPreviewSurface":
        context.reports.add(
            f"shader {identifier or 'without id'}",
            f"surface {identifier or 'without info:id'} is not supported: displayColor is used instead",
            path,
        )
        return None
    return _Reader(material, shader, network, context).preview_surface()


def _terminal(material: UsdShade.Material, name: str) -> UsdShade.Shader:
    """The shader of a material's terminal, "surface" or "displacement"; an invalid one where it has none."""
    compute = material.ComputeSurfaceSource if name == "surface" else material.ComputeDisplacementSource
    own = compute(RENDER_CONTEXT)[0] if material.GetOutput(f"{RENDER_CONTEXT}:{name}") else None
    return own or compute()[0]


class _Reader:
    """Reads one material; what is not supported is reported under its path."""

    def __init__(
        self,
        material: UsdShade.Material,
        shader: UsdShade.Shader,
        network: Network,
        context: SyncContext,
    ) -> None:
        self._material = material
        self._shader = shader
        self._network = network
        self._context = context
        self._tangents = False

    def preview_surface(self) -> MaterialData:
        inputs: dict[str, Any] = {}
        for name, (key, default) in _COLOURS.items():
            inputs[key] = self._network.vector(self._shader, name, default)
        for name, (key, number) in _NUMBERS.items():
            inputs[key] = self._in_range(name, self._network.number(self._shader, name, number))
        if not isinstance(inputs["ior"], dict) and inputs["ior"] <= 0:
            self._network.report("bad ior", f"ior {inputs['ior']:g} is not above 0: 1.5 is used")
            inputs["ior"] = 1.5
        inputs["normal"] = self._normal()
        threshold = self._threshold()
        cut_out = False
        if threshold > 0 and not isinstance(inputs["opacity"], dict):
            cut_out = inputs["opacity"] < threshold
            inputs["opacity"] = 1.0  # a mask: what is not cut out is opaque
        return self._finish(inputs, threshold, cut_out)

    def glsl_surface(self) -> MaterialData | None:
        shader = glsl.read_glsl(self._shader, self._network, self._context, glsl.SURFACE_OPTIONS)
        if shader is None:
            return None
        return self._finish({}, self._threshold(), surface_shader=shader)

    def _finish(
        self, inputs: dict[str, Any], threshold: float, cut_out: bool = False, **more: Any
    ) -> MaterialData:
        displacement_shader = self._displacement(inputs)
        specular = self._network.constant_number(self._shader, "useSpecularWorkflow", 0)
        network = self._network
        optional = frozenset(network.optional)
        if displacement_shader or "surface_shader" in more:
            optional |= {_GLSL_TEXCOORD} - _needed(network.nodes)
        return MaterialData(
            str(self._material.GetPath()),
            inputs,
            network.nodes,
            bool(specular),
            threshold,
            self._opacity_mode(),
            self._priority(),
            displacement_shader=displacement_shader,
            primvars=network.primvars,
            tangents=self._tangents,
            optional=optional,
            cut_out=cut_out,
            **more,
        )

    def _in_range(self, name: str, value: Input) -> Input:
        """A constant within the specification's range; textures are held there where they are read."""
        if isinstance(value, dict) or name == "ior" or 0 <= value <= 1:
            return value
        held = min(max(value, 0.0), 1.0)
        self._network.report(f"bad {name}", f"{name} {value:g} is not from 0 to 1: {held:g} is used")
        return held

    def _threshold(self) -> float:
        return max(self._network.constant_number(self._shader, "opacityThreshold", 0.0), 0.0)

    def _opacity_mode(self) -> str:
        mode = str(self._network.constant(self._shader, "opacityMode", "transparent"))
        if mode in _OPACITY_MODES:
            return mode
        self._network.report("opacityMode", f"opacityMode {mode} is unknown: transparent is used")
        return "transparent"

    def _normal(self) -> Input:
        """The normal in the tangent frame of texture coordinates: those of its texture, or st."""
        found = self._network.vector(self._shader, "normal", _UP)
        if not isinstance(found, dict):
            if not any(found):
                self._network.report("bad normal", "a normal of length 0 has no direction: it has no effect")
                return _UP
            self._tangents = found != _UP
            return found
        node = self._network.nodes[found["node"]]
        if node["kind"] != "texture":
            self._tangents = True
            return found
        if not node["texcoord"]:
            self._network.report(
                "input normal",
                f"{node['path']} has no texture coordinates to give normals in: it has no effect",
            )
            return _UP
        if node["texture"] < 0:
            return _UP  # reported; its fallback is meant for colours
        self._check_normal_map(node)
        return found

    def _check_normal_map(self, node: dict[str, Any]) -> None:
        is_8_bit = self._network.is_8_bit(node)
        if is_8_bit and node["bias"][:2] == (0.0, 0.0):
            self._network.report(
                "normal map",
                f"{node['path']} has 8 bits, and should have scale 2 and bias -1 for directions below 0",
            )

    def _displacement(self, inputs: dict[str, Any]) -> dict[str, Any] | None:
        """Sets the input, or gives the shader, that the material's displacement output is connected to."""
        shader = _terminal(self._material, "displacement")
        network = self._network
        if not shader:
            self._report_unused_displacement()
            return None
        if glsl.is_glsl(shader):
            return glsl.read_glsl(shader, network, self._context)
        if shader.GetShaderId() == "UsdPreviewSurface":
            inputs["displacement"] = network.number(shader, "displacement", 0.0)
            return None
        identifier = shader.GetShaderId() or "without info:id"
        network.report(
            f"shader {identifier}", f"displacement {identifier} is not supported: it has no effect"
        )
        return None

    def _report_unused_displacement(self) -> None:
        found = self._shader.GetInput("displacement")
        if self._shader.GetShaderId() != "UsdPreviewSurface" or not found:
            return
        if found.HasConnectedSource() or found.Get(self._context.time) not in (None, 0.0):
            self._network.report(
                "input displacement",
                "displacement has no effect: the material's displacement output is not connected",
            )

    def _priority(self) -> int:
        attribute = self._material.GetPrim().GetAttribute(DIELECTRIC_PRIORITY)
        value = attribute.Get(self._context.time) if attribute and attribute.HasAuthoredValue() else 0
        number = floats(value, 1)
        if number is None or number[0] != int(number[0]) or abs(number[0]) >= 2**31:
            self._network.report(
                "bad dielectricPriority", f"{DIELECTRIC_PRIORITY} {value} is no whole number: 0 is used"
            )
            return 0
        return int(number[0])


def _name_read(node: dict[str, Any]) -> str:
    """The primvar that a node for primvars or textures reads."""
    return str(node["primvar"] if node["kind"] == "primvar" else node["texcoord"])


def _needed(nodes: list[dict[str, Any]]) -> set[str]:
    """Texture coordinates that textures read, and that must be there for them."""
    return {n["texcoord"] for n in nodes if n["kind"] == "texture" and "texcoord_fallback" not in n}


def bound_materials(
    prims: list[Usd.Prim],
    purposes: tuple[str, ...],
    dangling: dict[Sdf.Path, Usd.Relationship] | None = None,
) -> list[UsdShade.Material | None]:
    """The material bound to each prim, for the first purpose that has one (allPurpose counts for all).

    dangling: takes the bindings, by prim, that name no material.
    """
    found: list[UsdShade.Material | None] = [None] * len(prims)
    for purpose in purposes:
        missing = [i for i, material in enumerate(found) if material is None]
        if not missing:
            break
        materials, bindings = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(
            [prims[i] for i in missing], purpose
        )
        for i, material, binding in zip(missing, materials, bindings, strict=True):
            found[i] = material if material else None
            if dangling is not None and binding and not material:
                dangling.setdefault(prims[i].GetPath(), binding)
    return found


def report_dangling(binding: Usd.Relationship, reports: Reports) -> None:
    """Reports a binding that names no material, at the prim that has it."""
    targets = binding.GetForwardedTargets()
    name = targets[-1] if targets else "nothing"  # of bindings to collections, the first is the collection
    reports.error(
        "missing material", f"is bound to {name}, which is no material: it has none", binding.GetPrimPath()
    )
