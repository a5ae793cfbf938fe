"""A small stage with something of everything that is translated, and edits to each part of it."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from stages import (
    add_material,
    add_point_instancer,
    add_square,
    add_strip,
    bind,
    connect_reader,
    connect_texture,
    new_stage,
    surface,
    write_image,
)

ASSET = """#usda 1.0
(
    defaultPrim = "Asset"
)
def Xform "Asset" (
    variants = {
        string shape = "square"
    }
    prepend variantSets = "shape"
)
{
    color3f[] primvars:displayColor = [(0.2, 0.4, 0.6)]
    def Cube "Cube"
    {
        double size = 0.5
    }
    def Xform "Inner" (
        instanceable = true
        references = </Leaf>
    )
    {
        double3 xformOp:translate = (0, 2, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    variantSet "shape" = {
        "square" {
            def Mesh "Shape"
            {
                int[] faceVertexCounts = [4]
                int[] faceVertexIndices = [0, 1, 2, 3]
                point3f[] points = [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
                uniform token subdivisionScheme = "none"
            }
        }
        "sphere" {
            def Sphere "Shape"
            {
                double radius = 0.25
            }
        }
    }
}
def Xform "Leaf"
{
    def Cone "Cone"
    {
        double height = 1
    }
}
"""


def make_stage(folder: Path) -> Usd.Stage:
    """/World with meshes, subsets, materials, textures, lights, instances of all sorts, and animation."""
    (folder / "asset.usda").write_text(ASSET)
    write_image(folder / "a.png", np.full((2, 2, 3), 0.5))
    write_image(folder / "b.png", np.full((4, 2, 3), 0.25))
    stage = new_stage()
    _looks(stage, folder)
    _meshes(stage)
    _instances(stage, folder)
    _lights(stage)
    camera = UsdGeom.Camera.Define(stage, "/World/main_cam")
    camera.AddTranslateOp().Set((0, 0, 20))
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    return stage


def _looks(stage: Usd.Stage, folder: Path) -> None:
    looks = "/World/Looks"
    add_material(stage, f"{looks}/Red", diffuseColor=(1, 0, 0), roughness=0.5)
    add_material(stage, f"{looks}/Glass", opacity=0.2, ior=1.3)
    textured = add_material(stage, f"{looks}/Textured", roughness=0.3)
    connect_texture(stage, surface(textured), str(folder / "a.png"))
    reading = add_material(stage, f"{looks}/Reading")
    connect_reader(stage, surface(reading), "float3", "tint", "diffuseColor", (0.1, 0.2, 0.3))


def _meshes(stage: Usd.Stage) -> None:
    group = UsdGeom.Xform.Define(stage, "/World/Group")
    group.AddTranslateOp().Set((1, 0, 0))
    tint = UsdGeom.PrimvarsAPI(group).CreatePrimvar("tint", Sdf.ValueTypeNames.Color3fArray, "constant")
    tint.Set([(0.5, 0.6, 0.7)])
    plain = add_square(stage, "/World/Group/Plain")
    plain.CreateDisplayColorAttr([(0.9, 0.1, 0.1)])
    textured = add_square(stage, "/World/Group/Textured", "catmullClark")
    st = UsdGeom.PrimvarsAPI(textured).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    bind(textured, UsdShade.Material.Get(stage, "/World/Looks/Textured"))
    reading = add_square(stage, "/World/Group/Deep/Reading")
    bind(reading, UsdShade.Material.Get(stage, "/World/Looks/Reading"))
    strip = add_strip(stage, "/World/Strip")
    bind(strip, UsdShade.Material.Get(stage, "/World/Looks/Red"))
    subset = UsdGeom.Subset.CreateGeomSubset(strip, "Middle", "face", [1], "materialBind")
    bind(subset, UsdShade.Material.Get(stage, "/World/Looks/Glass"))
    moving = add_square(stage, "/World/Moving")
    op = moving.AddTranslateOp()
    op.Set((0, 5, 0), 1)
    op.Set((4, 5, 0), 5)
    bending = add_square(stage, "/World/Bending")
    bending.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 1)
    bending.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (1, 1, 2), (0, 1, 0)], 5)
    hidden = add_square(stage, "/World/Hidden")
    hidden.CreateVisibilityAttr("invisible")
    add_square(stage, "/World/Guide").CreatePurposeAttr("guide")
    blinking = add_square(stage, "/World/Blinking")
    blinking.CreateVisibilityAttr().Set("invisible", 1)
    blinking.GetVisibilityAttr().Set("inherited", 3)
    collected = add_square(stage, "/World/Collected/Mesh")
    collection = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/World/Collected"), "all")
    collection.CreateIncludesRel().AddTarget(collected.GetPath())
    binding = UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World/Collected"))
    binding.Bind(collection, UsdShade.Material.Get(stage, "/World/Looks/Red"), "all")


def _instances(stage: Usd.Stage, folder: Path) -> None:
    for i in range(3):
        xform = UsdGeom.Xform.Define(stage, f"/World/Assets/I{i}")
        xform.AddTranslateOp().Set((3.0 * i, -4, 0))
        xform.GetPrim().GetReferences().AddReference(str(folder / "asset.usda"))
        xform.GetPrim().SetInstanceable(True)
    payload = UsdGeom.Xform.Define(stage, "/World/Loaded")
    payload.GetPrim().GetPayloads().AddPayload(str(folder / "asset.usda"))
    add_square(stage, "/World/Instancer/Square").CreateDisplayColorAttr([(0, 0, 1)])
    UsdGeom.Sphere.Define(stage, "/World/Instancer/Ball").CreateRadiusAttr(0.3)
    add_point_instancer(
        stage,
        "/World/Instancer",
        ["/World/Instancer/Square", "/World/Instancer/Ball"],
        [0, 1, 0, 1],
    )


def _lights(stage: Usd.Stage) -> None:
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    sun.CreateIntensityAttr(2.0)
    UsdLux.SphereLight.Define(stage, "/World/Lamp").AddTranslateOp().Set((0, 9, 0))
    glow = add_square(stage, "/World/Glow")
    UsdLux.MeshLightAPI.Apply(glow.GetPrim())
    linked = Usd.CollectionAPI(stage.GetPrimAtPath("/World/Lamp"), "lightLink")
    linked.CreateExcludesRel().AddTarget("/World/Strip")


Edit = Callable[[Usd.Stage, random.Random], object]


def _mesh(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    return UsdGeom.Mesh(stage.GetPrimAtPath(path) or stage.DefinePrim(path, "Mesh"))


def _points(random_: random.Random, count: int = 4) -> list[Gf.Vec3f]:
    return [Gf.Vec3f(*(random_.uniform(-1, 1) for _ in range(3))) for _ in range(count)]


def _toggle(stage: Usd.Stage, path: str) -> None:
    visibility = UsdGeom.Imageable(stage.OverridePrim(path)).CreateVisibilityAttr()
    visibility.Set("inherited" if visibility.Get() == "invisible" else "invisible")


def _move(stage: Usd.Stage, path: str, random_: random.Random) -> None:
    xform = UsdGeom.XformCommonAPI(stage.OverridePrim(path))
    xform.SetTranslate(Gf.Vec3d(*(random_.uniform(-5, 5) for _ in range(3))))


def _input(stage: Usd.Stage, look: str, name: str, value: object) -> None:
    shader = surface(UsdShade.Material.Get(stage, f"/World/Looks/{look}"))
    kind = Sdf.ValueTypeNames.Float if isinstance(value, float) else Sdf.ValueTypeNames.Color3f
    shader.CreateInput(name, kind).Set(value)


def _bind(stage: Usd.Stage, path: str, look: str) -> None:
    bind(stage.OverridePrim(path), UsdShade.Material.Get(stage, f"/World/Looks/{look}"))


def _new(stage: Usd.Stage, random_: random.Random) -> None:
    add_square(stage, f"/World/Group/New{random_.randrange(3)}").CreateDisplayColorAttr([(0, 1, 0)])


def _rename(stage: Usd.Stage, random_: random.Random) -> None:
    editor = Usd.NamespaceEditor(stage)
    old, new = "/World/Group/Plain", "/World/Group/Renamed"
    if not stage.GetPrimAtPath(old):
        old, new = new, old
    if stage.GetPrimAtPath(old):
        editor.MovePrimAtPath(old, new)
        editor.ApplyEdits()


def _variant(stage: Usd.Stage, path: str, random_: random.Random) -> None:
    sets = stage.OverridePrim(path).GetVariantSets()
    sets.GetVariantSet("shape").SetVariantSelection(random_.choice(["square", "sphere"]))


def _load(stage: Usd.Stage, random_: random.Random) -> None:
    prim = stage.GetPrimAtPath("/World/Loaded")
    if prim and prim.IsLoaded():
        prim.Unload()
    elif prim:
        prim.Load()


def _activate(stage: Usd.Stage, path: str) -> None:
    prim = stage.OverridePrim(path)
    prim.SetActive(not prim.IsActive())


def _instanceable(stage: Usd.Stage, path: str) -> None:
    prim = stage.OverridePrim(path)
    prim.SetInstanceable(not prim.IsInstanceable())


def _attribute(stage: Usd.Stage, path: str, name: str, value: object) -> None:
    prim = stage.GetPrimAtPath(path)
    if prim and prim.HasAttribute(name):
        prim.GetAttribute(name).Set(value)


def _instances_of(stage: Usd.Stage, random_: random.Random) -> None:
    count = random_.randrange(1, 6)
    indices = [random_.randrange(2) for _ in range(count)]
    with Sdf.ChangeBlock():
        _attribute(stage, "/World/Instancer", "protoIndices", indices)
        _attribute(stage, "/World/Instancer", "positions", _points(random_, count))


def _in_prototype(stage: Usd.Stage, path: str, name: str, value: object) -> None:
    """Edits the layer that instances refer to."""
    for layer in stage.GetUsedLayers():
        if layer.identifier.endswith("asset.usda"):
            attribute = layer.GetAttributeAtPath(f"{path}.{name}")
            if attribute:
                attribute.default = value


def _new_in_prototype(stage: Usd.Stage, random_: random.Random) -> None:
    for layer in stage.GetUsedLayers():
        if layer.identifier.endswith("asset.usda"):
            Sdf.CreatePrimInLayer(layer, f"/Asset/Cube{random_.randrange(2)}").specifier = Sdf.SpecifierDef
            layer.GetPrimAtPath(
                "/Asset/Cube0" if layer.GetPrimAtPath("/Asset/Cube0") else "/Asset/Cube1"
            ).typeName = random_.choice(["Cube", "Sphere", "Xform"])


def _mute(stage: Usd.Stage, random_: random.Random) -> None:
    for layer in list(stage.GetMutedLayers()):
        stage.UnmuteLayer(layer)
        return
    name = next((la.identifier for la in stage.GetUsedLayers() if la.identifier.endswith("asset.usda")), "")
    if name:
        stage.MuteLayer(name)


def _session(stage: Usd.Stage, random_: random.Random) -> None:
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        _toggle(stage, random_.choice(["/World/Strip", "/World/Group"]))


def _clear_session(stage: Usd.Stage, random_: random.Random) -> None:
    stage.GetSessionLayer().Clear()


def _texture(stage: Usd.Stage, random_: random.Random) -> None:
    shader = UsdShade.Shader.Get(stage, "/World/Looks/Textured/Surface_diffuseColor")
    if shader:
        file = shader.GetInput("file")
        folder = Path(file.Get().path).parent
        file.Set(Sdf.AssetPath(str(folder / random_.choice(["a.png", "b.png", "missing.png"]))))


def _inherited_primvar(stage: Usd.Stage, random_: random.Random) -> None:
    api = UsdGeom.PrimvarsAPI(
        stage.OverridePrim(random_.choice(["/World", "/World/Group", "/World/Assets/I1"]))
    )
    name = random_.choice(["tint", "displayColor"])
    primvar = api.CreatePrimvar(name, Sdf.ValueTypeNames.Color3fArray, "constant")
    primvar.Set([Gf.Vec3f(random_.random(), 0.5, 0.5)])


def _remove_primvar(stage: Usd.Stage, random_: random.Random) -> None:
    stage.OverridePrim("/World/Group").RemoveProperty("primvars:tint")


def _subset(stage: Usd.Stage, random_: random.Random) -> None:
    _attribute(stage, "/World/Strip/Middle", "indices", [random_.randrange(4)])


def _subset_goes(stage: Usd.Stage, random_: random.Random) -> None:
    _activate(stage, "/World/Strip/Middle")


def _collection(stage: Usd.Stage, random_: random.Random) -> None:
    prim = stage.GetPrimAtPath("/World/Collected")
    if prim:
        target = random_.choice(["/World/Collected/Mesh", "/World/Nothing"])
        Usd.CollectionAPI(prim, "all").CreateIncludesRel().SetTargets([target])


def _linking(stage: Usd.Stage, random_: random.Random) -> None:
    prim = stage.GetPrimAtPath("/World/Lamp")
    if prim:
        rel = Usd.CollectionAPI(prim, "lightLink").CreateExcludesRel()
        rel.SetTargets(random_.choice([[], ["/World/Strip"], ["/World/Group", "/World/Glow"]]))


def _animate(stage: Usd.Stage, random_: random.Random) -> None:
    path = random_.choice(["/World/Strip", "/World/Group", "/World/Assets/I2"])
    UsdGeom.XformCommonAPI(stage.OverridePrim(path)).SetTranslate(
        (random_.random(), 0, 0), random_.randrange(1, 6)
    )


def _animate_look(stage: Usd.Stage, random_: random.Random) -> None:
    shader = surface(UsdShade.Material.Get(stage, "/World/Looks/Red"))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(random_.random(), random_.randrange(1, 6))


def _new_look(stage: Usd.Stage, random_: random.Random) -> None:
    add_material(stage, "/World/Looks/Later", diffuseColor=(random_.random(), 0.0, 1.0))
    rel = UsdShade.MaterialBindingAPI.Apply(stage.OverridePrim("/World/Bending")).GetDirectBindingRel()
    rel.SetTargets(["/World/Looks/Later"])


def _connect(stage: Usd.Stage, random_: random.Random) -> None:
    """Material Red's roughness comes from a node graph elsewhere."""
    graph = UsdShade.NodeGraph.Define(stage, "/World/Graphs/G")
    value = graph.CreateInput("amount", Sdf.ValueTypeNames.Float)
    value.Set(random_.random())
    shader = surface(UsdShade.Material.Get(stage, "/World/Looks/Red"))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).ConnectToSource(value)


EDITS: dict[str, Edit] = {
    "visibility": lambda s, r: _toggle(s, "/World/Group/Plain"),
    "visibility of a group": lambda s, r: _toggle(s, "/World/Group"),
    "what was hidden": lambda s, r: _toggle(s, "/World/Hidden"),
    "visibility of an instance": lambda s, r: _toggle(s, f"/World/Assets/I{r.randrange(3)}"),
    "visibility of a light": lambda s, r: _toggle(s, "/World/Sun"),
    "purpose": lambda s, r: (
        UsdGeom.Imageable(s.OverridePrim("/World/Strip"))
        .CreatePurposeAttr()
        .Set(r.choice(["default", "guide", "proxy"]))
    ),
    "transform": lambda s, r: _move(s, "/World/Strip", r),
    "transform of a group": lambda s, r: _move(s, "/World/Group", r),
    "transform of an instance": lambda s, r: _move(s, f"/World/Assets/I{r.randrange(3)}", r),
    "transform of an instancer": lambda s, r: _move(s, "/World/Instancer", r),
    "transform of a prototype": lambda s, r: _move(s, "/World/Instancer/Ball", r),
    "transform of a light": lambda s, r: _move(s, "/World/Lamp", r),
    "points": lambda s, r: _attribute(s, "/World/Group/Plain", "points", _points(r)),
    "points of a subdivided mesh": lambda s, r: _attribute(s, "/World/Group/Textured", "points", _points(r)),
    "too few points": lambda s, r: _attribute(s, "/World/Strip", "points", _points(r, r.randrange(7, 9))),
    "points of a light": lambda s, r: _attribute(s, "/World/Glow", "points", _points(r)),
    "topology": lambda s, r: _attribute(s, "/World/Group/Plain", "faceVertexIndices", r.sample(range(4), 4)),
    "scheme": lambda s, r: _attribute(
        s, "/World/Group/Plain", "subdivisionScheme", r.choice(["none", "catmullClark"])
    ),
    "holes": lambda s, r: _mesh(s, "/World/Group/Textured").CreateHoleIndicesAttr([r.randrange(2)]),
    "orientation": lambda s, r: _mesh(s, "/World/Strip").CreateOrientationAttr(
        r.choice(["leftHanded", "rightHanded"])
    ),
    "display colour": lambda s, r: _mesh(s, "/World/Group/Plain").CreateDisplayColorAttr(
        [(r.random(), 0, 0)]
    ),
    "texture coordinates": lambda s, r: _attribute(
        s, "/World/Group/Textured", "primvars:st", [(r.random(), r.random()) for _ in range(4)]
    ),
    "inherited primvar": _inherited_primvar,
    "no inherited primvar": _remove_primvar,
    "a material": lambda s, r: _input(s, "Red", "diffuseColor", Gf.Vec3f(r.random(), 0, 0)),
    "another material": lambda s, r: _input(s, "Glass", "ior", 1.0 + r.random()),
    "a cut-out": lambda s, r: _input(s, "Glass", "opacityThreshold", float(r.randrange(2))),
    "a node": _connect,
    "a node's value": lambda s, r: _attribute(s, "/World/Graphs/G", "inputs:amount", r.random()),
    "texture": _texture,
    "new material": _new_look,
    "removed material": lambda s, r: s.RemovePrim("/World/Looks/Glass"),
    "restored material": lambda s, r: add_material(s, "/World/Looks/Glass", opacity=0.4),
    "binding": lambda s, r: _bind(s, "/World/Group/Plain", r.choice(["Red", "Textured", "Reading"])),
    "binding of a group": lambda s, r: _bind(s, "/World/Group", r.choice(["Red", "Textured"])),
    "binding of an instance": lambda s, r: _bind(s, "/World/Assets/I1", r.choice(["Red", "Reading"])),
    "unbound": lambda s, r: UsdShade.MaterialBindingAPI(s.OverridePrim("/World/Strip")).UnbindAllBindings(),
    "subset": _subset,
    "subset goes": _subset_goes,
    "collection": _collection,
    "linking": _linking,
    "new prim": _new,
    "removed prim": lambda s, r: s.RemovePrim(f"/World/Group/New{r.randrange(3)}"),
    "renamed": _rename,
    "activated": lambda s, r: _activate(s, "/World/Strip"),
    "an activated group": lambda s, r: _activate(s, "/World/Group/Deep"),
    "an activated instance": lambda s, r: _activate(s, "/World/Assets/I0"),
    "instanceable": lambda s, r: _instanceable(s, "/World/Assets/I1"),
    "payload": _load,
    "variant": lambda s, r: _variant(s, "/World/Loaded", r),
    "variant of an instance": lambda s, r: _variant(s, f"/World/Assets/I{r.randrange(3)}", r),
    "type": lambda s, r: s.OverridePrim("/World/Bending").SetTypeName(r.choice(["Mesh", "Xform", "Sphere"])),
    "light": lambda s, r: UsdLux.LightAPI(s.OverridePrim("/World/Sun")).CreateIntensityAttr(r.random()),
    "mesh light": lambda s, r: UsdLux.LightAPI(s.OverridePrim("/World/Glow")).CreateIntensityAttr(r.random()),
    "camera": lambda s, r: _move(s, "/World/main_cam", r),
    "lens": lambda s, r: _attribute(s, "/World/main_cam", "focalLength", r.uniform(20, 80)),
    "shutter": lambda s, r: _attribute(s, "/World/main_cam", "shutter:close", r.choice([0.0, 0.25, 0.5])),
    "camera goes": lambda s, r: _activate(s, "/World/main_cam"),
    "positions": lambda s, r: _attribute(s, "/World/Instancer", "positions", _points(r)),
    "instances": _instances_of,
    "invisible ids": lambda s, r: (
        UsdGeom.PointInstancer(s.OverridePrim("/World/Instancer"))
        .CreateInvisibleIdsAttr()
        .Set([r.randrange(4)])
    ),
    "prototype of an instancer": lambda s, r: _attribute(s, "/World/Instancer/Square", "points", _points(r)),
    "radius of a prototype": lambda s, r: _attribute(s, "/World/Instancer/Ball", "radius", r.random()),
    "content of a prototype": lambda s, r: _in_prototype(s, "/Asset/Cube", "size", 0.5 + r.random()),
    "content of a nested prototype": lambda s, r: _in_prototype(s, "/Leaf/Cone", "height", 0.5 + r.random()),
    "colour of a prototype": lambda s, r: _in_prototype(
        s, "/Asset", "primvars:displayColor", [Gf.Vec3f(r.random(), 0, 0)]
    ),
    "transform in a prototype": lambda s, r: _in_prototype(
        s, "/Asset/Inner", "xformOp:translate", Gf.Vec3d(0, r.random(), 0)
    ),
    "new prim in a prototype": _new_in_prototype,
    "muted layer": _mute,
    "session layer": _session,
    "no session layer": _clear_session,
    "animation": _animate,
    "animated material": _animate_look,
    "up axis": lambda s, r: UsdGeom.SetStageUpAxis(s, r.choice(["Y", "Z"])),
    "time codes per second": lambda s, r: s.SetTimeCodesPerSecond(r.choice([24, 48])),
    "interpolation": lambda s, r: s.SetInterpolationType(
        r.choice([Usd.InterpolationTypeHeld, Usd.InterpolationTypeLinear])
    ),
    "draw mode": lambda s, r: UsdGeom.ModelAPI.Apply(s.OverridePrim("/World/Group")).CreateModelDrawModeAttr(
        r.choice(["default", "bounds"])
    ),
    "words": lambda s, r: s.OverridePrim("/World/Strip").SetDocumentation(str(r.random())),
}
