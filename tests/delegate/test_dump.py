"""The canonical text of a translated scene."""

from pathlib import Path

import numpy as np
from encore.dump import dump
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade
from stages import (
    add_material,
    add_square,
    add_strip,
    bind,
    connect_texture,
    surface,
    translate,
    write_image,
)


def test_a_small_scene(stage: Usd.Stage) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateHorizontalApertureAttr(50.0)
    camera.CreateVerticalApertureAttr(25.0)
    camera.AddTranslateOp().Set((0, 0, 5))
    mesh = add_square(stage, "/World/Mesh")
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateDisplayColorAttr([(1, 0.5, 0)])
    mesh.AddTranslateOp().Set((1, 2, 3))
    UsdLux.DistantLight.Define(stage, "/World/Sun").CreateAngleAttr(0.0)
    assert (
        dump(translate(stage, width=100))
        == """\
image 100 x 50
camera /World/Camera
  projection: perspective
  to_world: (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1)
  half_tangent: (0.5, 0.25)
  centre_tangent: (0, 0)
  near_clip: 1
  far_clip: 1e+06
  exposure_scale: 1
light /World/Sun
  kind: distant
  radiance: (50000, 50000, 50000)
  diffuse: 1
  specular: 1
  direction: (0, 0, -1)
  angle_radians: 0
material default
  diffuse_color: (0.18, 0.18, 0.18)
  emissive_color: (0, 0, 0)
  specular_color: (0, 0, 0)
  metallic: 0
  roughness: 1
  clearcoat: 0
  clearcoat_roughness: 0.01
  opacity: 1
  ior: 1
  use_specular_workflow: False
  opacity_threshold: 0
material displayColor(1, 0.5, 0)
  diffuse_color: (1, 0.5, 0)
  emissive_color: (0, 0, 0)
  specular_color: (0, 0, 0)
  metallic: 0
  roughness: 1
  clearcoat: 0
  clearcoat_roughness: 0.01
  opacity: 1
  ior: 1
  use_specular_workflow: False
  opacity_threshold: 0
mesh /World/Mesh
  scheme: none
  interpolate_boundary: edgeAndCorner
  face_varying: cornersPlus1
  triangle_subdivision: catmullClark
  left_handed: False
  double_sided: True
  points: (0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0)
  face_vertex_counts: (4)
  face_vertex_indices: (0, 1, 2, 3)
  target_edge_length_world: 0
  shading_rate: (0, 0, 0)
  material: displayColor(1, 0.5, 0)
prototype /World/Mesh
  meshes: /World/Mesh
instance /World/Mesh
  prototype: /World/Mesh
  to_world: (1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 2, 3)
report Note: /World/Camera: is the stage's only camera, and is used.
"""
    )


def test_everything_else_has_its_line(stage: Usd.Stage, tmp_path: Path) -> None:
    mesh = add_strip(stage, "/World/Mesh")
    mesh.CreateDisplayColorPrimvar("uniform").Set([(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    api = UsdGeom.PrimvarsAPI(mesh)
    st = api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "uniform")
    st.Set([(0, 0), (1, 1)])
    st.SetIndices([0, 1, 0])
    material = add_material(stage, "/World/Textured")
    connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("one", [1])
    bind(subset, material)
    text = dump(translate(stage))
    for line in (
        "material displayColor\n  diffuse_color: node displayColor channel 0",
        "  node displayColor displayColor",
        "  diffuse_color: node /World/Textured/Surface_diffuseColor channel 0",
        "    st_transform: (1, 0, 0, 0, 1, 0)",
        "    wrap_s: black",
        "  displayColor: uniform (1, 0, 0, 0, 1, 0, 0, 0, 1)",
        "  st: uniform (0, 0, 1, 1) indices (0, 1, 0)",
        "  face_materials: - /World/Textured -",
        f"texture {tmp_path / 'a.png'}\n  size: 1 x 1",
    ):
        assert line in text, line


def test_lights_and_cameras_say_what_matters_of_their_kind(stage: Usd.Stage, tmp_path: Path) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFStopAttr(2.5)
    camera.CreateFocusDistanceAttr(4.0)
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    camera.CreateClippingPlanesAttr([(0, 0, 1, 2)])
    mesh = add_square(stage, "/World/Mesh")
    UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
    op = mesh.AddTranslateOp()
    op.Set((0, 0, 0), 0)
    op.Set((4, 0, 0), 2)
    dome = UsdLux.DomeLight.Define(stage, "/World/Dome")
    dome.CreateTextureFileAttr(write_image(tmp_path / "sky.exr"))
    spot = UsdLux.SphereLight.Define(stage, "/World/Spot").GetPrim()
    UsdLux.ShapingAPI.Apply(spot).CreateShapingConeAngleAttr(180 / np.pi)
    UsdLux.ShadowAPI.Apply(spot).CreateShadowDistanceAttr(3.0)
    Usd.CollectionAPI(spot, "lightLink").CreateExcludesRel().AddTarget("/World/Mesh")
    text = dump(translate(stage, time=Usd.TimeCode(1)))
    for line in (
        "\nshutter -0.25 to 0.25\n",
        "\n  clipping_planes: (0, 0, 1, 2)\n  lens_radius: 1\n  focus_distance: 4\n  aperture_blades: 0\n",
        "\n  motion: (1, 0, 0, 0, 1, 0, 0, 0, 1, 1.5, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 2.5, 0, 0)\n",
        "\nlight /World/Mesh\n  kind: mesh\n  radiance: (1, 1, 1)\n  diffuse: 1\n  specular: 1\n"
        "  instance: /World/Mesh\n",
        f"\n  axis_z: (0, 0, 1)\n  texture: {tmp_path / 'sky.exr'} latlong\n",
        "\n  lit_groups: (0)\n",
        "\n  cone_angle_radians: 1\n",
        "\n  shadow_distance: 3\n",
        "\n  link_group: 0\n",
    ):
        assert line in text, text


def test_equal_scenes_have_equal_text_and_long_arrays_a_checksum(stage: Usd.Stage) -> None:
    sphere = UsdGeom.Sphere.Define(stage, "/World/Sphere")
    first = dump(translate(stage))
    assert dump(translate(stage)) == first
    assert "points: [8320 x 3] -1 to 1, crc " in first
    sphere.CreateRadiusAttr(2.0)
    assert dump(translate(stage)) != first


def test_a_moved_point_changes_the_text(stage: Usd.Stage) -> None:
    mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
    points = np.random.default_rng(1).random((300, 3)).astype(np.float32)
    mesh.CreateFaceVertexCountsAttr([3] * 100)
    mesh.CreateFaceVertexIndicesAttr(list(range(300)))
    mesh.CreatePointsAttr(points.tolist())
    first = dump(translate(stage))
    points[150] = points[149]
    mesh.CreatePointsAttr(points.tolist())
    assert dump(translate(stage)) != first
