// Scene::validate(), validateMesh(), Settings::validate() and rebase(): what is wrong is named, what is right passes.
#include "core/scene/scene.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/scene/error.h"

namespace encore {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Two quads side by side, with every optional attribute authored.
Mesh twoQuads() {
  Mesh mesh;
  mesh.path = "/world/quads";
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}, {1, 1, 0}, {2, 1, 0}};
  mesh.face_vertex_counts = {4, 4};
  mesh.face_vertex_indices = {0, 1, 4, 3, 1, 2, 5, 4};
  mesh.hole_indices = {1};
  mesh.corner_indices = {0, 2};
  mesh.corner_sharpnesses = {10, 2};
  mesh.crease_indices = {1, 4, 3, 0};
  mesh.crease_lengths = {2, 2};
  mesh.crease_sharpnesses = {1, 2};
  mesh.display_color = {"displayColor", Interpolation::Uniform, {{1, 0, 0}, {0, 1, 0}}, {}};
  mesh.texcoords = {{"st", Interpolation::FaceVarying, {{0, 0}, {1, 1}}, {0, 1, 0, 1, 0, 1, 0, 1}}};
  mesh.face_materials = {0, -1};
  return mesh;
}

Scene validScene() {
  Scene scene;
  scene.meshes = {twoQuads()};
  scene.prototypes = {{"/world/quads", {0}}};
  scene.instances = {{"/world/quads", 0, {}, {}, -1}};
  scene.instance_primvars = {"wear"};
  scene.textures = {{"ground.png", 2, 1, {0, 0, 0, 1, 1, 1, 1, 1}, {}}};
  Material material;
  material.path = "/looks/ground";
  material.nodes.resize(2);
  material.nodes[0].path = "/looks/ground/image";
  material.nodes[0].texture = 0;
  material.nodes[1].path = "/looks/ground/mask";
  material.nodes[1].texture = 0;
  material.diffuse_color.node = 0;
  material.roughness.node = 1;
  material.roughness.channel = 3;
  scene.materials = {material};
  Light light;
  light.path = "/lights/key";
  light.kind = Light::Kind::Rect;
  scene.lights = {light};
  scene.camera.path = "/camera";
  return scene;
}

// The message of the error that `action` throws, or "nothing thrown".
std::string messageOf(ErrorKind kind, const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind);
    EXPECT_FALSE(error.where().empty());
    EXPECT_FALSE(error.remedy().empty()) << error.what();
    return error.what();
  }
  return "nothing thrown";
}

// A change that makes a valid description invalid, and what the message must then contain.
template <class T>
struct Breakage {
  std::function<void(T&)> apply;
  std::vector<std::string> words;
};

template <class T>
void expectErrors(const T& valid, ErrorKind kind, const std::function<void(const T&)>& validate,
                  const std::vector<Breakage<T>>& breakages) {
  for (const Breakage<T>& breakage : breakages) {
    T broken = valid;
    breakage.apply(broken);
    const std::string message = messageOf(kind, [&] { validate(broken); });
    for (const std::string& word : breakage.words)
      EXPECT_NE(message.find(word), std::string::npos) << "no \"" << word << "\" in: " << message;
  }
}

void expectMeshErrors(const std::vector<Breakage<Mesh>>& breakages) {
  expectErrors<Mesh>(twoQuads(), ErrorKind::Scene, [](const Mesh& mesh) { validateMesh(mesh, 1); }, breakages);
}

TEST(ValidateMesh, AcceptsWhatIsValid) {
  EXPECT_NO_THROW(validateMesh(twoQuads(), 1));
  EXPECT_NO_THROW(validateMesh(Mesh{}, 1));  // nothing to render is not an error of the mesh
  Mesh per_edge = twoQuads();
  per_edge.crease_lengths = {4};
  per_edge.crease_sharpnesses = {1, 2, 3};
  EXPECT_NO_THROW(validateMesh(per_edge, 1));
  Mesh triangles = twoQuads();
  triangles.scheme = SubdivisionScheme::Loop;
  triangles.face_vertex_counts = {3, 3};
  triangles.face_vertex_indices = {0, 1, 4, 4, 3, 0};
  triangles.texcoords.clear();
  EXPECT_NO_THROW(validateMesh(triangles, 1));
}

TEST(ValidateMesh, NamesBadTopology) {
  expectMeshErrors({
      {[](Mesh& m) { m.face_vertex_counts[0] = 2; }, {"/world/quads.faceVertexCounts", "face 0", "2 vertices"}},
      {[](Mesh& m) { m.face_vertex_counts[1] = -4; }, {"faceVertexCounts", "face 1", "-4 vertices"}},
      {[](Mesh& m) { m.face_vertex_counts[1] = 5; }, {"/world/quads.faceVertexIndices", "8 elements", "ask for 9"}},
      {[](Mesh& m) { m.face_vertex_indices[3] = 6; }, {"faceVertexIndices", "index 6 at 3", "points number 6"}},
      {[](Mesh& m) { m.face_vertex_indices[5] = -1; }, {"faceVertexIndices", "index -1 at 5"}},
      {[](Mesh& m) { m.points.pop_back(); }, {"faceVertexIndices", "index 5 at 6", "points number 5"}},
      {[](Mesh& m) { m.scheme = SubdivisionScheme::Loop; }, {"faceVertexCounts", "4 vertices", "loop", "catmullClark"}},
  });
}

TEST(ValidateMesh, NamesFirstPointThatIsNotFinite) {
  expectMeshErrors({
      {[](Mesh& m) { m.points[4].y = kNan, m.points[5].x = kNan; }, {"/world/quads.points", "(1, nan, 0) at 4"}},
      {[](Mesh& m) { m.points[0].z = -kInfinity; }, {"/world/quads.points", "(0, 0, -inf) at 0"}},
  });
}

TEST(ValidateMesh, NamesBadSharpFeatures) {
  expectMeshErrors({
      {[](Mesh& m) { m.hole_indices = {2}; }, {"holeIndices", "index 2 at 0", "faces number 2"}},
      {[](Mesh& m) { m.corner_indices[1] = 6; }, {"cornerIndices", "index 6 at 1", "points number 6"}},
      {[](Mesh& m) { m.corner_sharpnesses.pop_back(); }, {"cornerSharpnesses", "1 elements", "ask for 2"}},
      {[](Mesh& m) { m.corner_sharpnesses[0] = kNan; }, {"cornerSharpnesses", "nan at 0"}},
      {[](Mesh& m) { m.crease_lengths[0] = 1; }, {"creaseLengths", "crease 0", "1 vertices"}},
      {[](Mesh& m) { m.crease_lengths[1] = 3; }, {"creaseIndices", "4 elements", "ask for 5"}},
      {[](Mesh& m) { m.crease_indices[2] = -7; }, {"creaseIndices", "index -7 at 2"}},
      {[](Mesh& m) { m.crease_sharpnesses.resize(3); }, {"creaseSharpnesses", "3 elements", "2 creases", "2 edges"}},
      {[](Mesh& m) { m.crease_sharpnesses[1] = kInfinity; }, {"creaseSharpnesses", "inf at 1"}},
  });
}

TEST(ValidateMesh, NamesBadPrimvars) {
  expectMeshErrors({
      {[](Mesh& m) { m.display_color.values.pop_back(); },
       {"primvars:displayColor", "1 elements", "uniform", "ask for 2"}},
      {[](Mesh& m) { m.display_color.interpolation = Interpolation::Constant; }, {"constant", "ask for 1"}},
      {[](Mesh& m) { m.display_color.interpolation = Interpolation::Vertex; }, {"vertex", "ask for 6"}},
      {[](Mesh& m) { m.texcoords[0].indices.pop_back(); },
       {"primvars:st:indices", "7 elements", "faceVarying", "ask for 8"}},
      {[](Mesh& m) { m.texcoords[0].indices[4] = 2; }, {"primvars:st:indices", "index 2 at 4", "values number 2"}},
      {[](Mesh& m) { m.texcoords[0].values.clear(); }, {"primvars:st:indices", "values number 0"}},
      {[](Mesh& m) { m.texcoords[0].values[1].x = kNan; }, {"primvars:st", "(nan, 1) at 1"}},
      {[](Mesh& m) { m.normals = {"normals", Interpolation::Varying, std::vector<Vec3f>(5), {}}; },
       {"/world/quads.normals", "5 elements", "varying", "ask for 6"}},
  });
}

TEST(ValidateMesh, NamesBadMaterialsAndSettings) {
  expectMeshErrors({
      {[](Mesh& m) { m.face_materials = {0}; }, {"material:binding", "1 elements", "ask for 2"}},
      {[](Mesh& m) { m.face_materials[0] = 1; }, {"material:binding", "index 1 at 0", "materials number 1"}},
      {[](Mesh& m) { m.face_materials[1] = -2; }, {"material:binding", "index -2 at 1"}},
      {[](Mesh& m) { m.material = -1; }, {"material:binding", "index -1"}},
      {[](Mesh& m) { m.target_edge_length_world = -1; }, {"primvars:encore:targetEdgeLength", "-1"}},
      {[](Mesh& m) { m.target_edge_length_world = kNan; }, {"primvars:encore:targetEdgeLength", "nan"}},
      {[](Mesh& m) { m.shading_rate[0] = kInfinity; }, {"primvars:encore:shadingRate:direct", "inf"}},
      {[](Mesh& m) { m.shading_rate[2] = -1; }, {"primvars:encore:shadingRate:refraction", "-1"}},
  });
}

void expectSceneErrors(const std::vector<Breakage<Scene>>& breakages) {
  expectErrors<Scene>(validScene(), ErrorKind::Scene, [](const Scene& scene) { scene.validate(); }, breakages);
}

TEST(ValidateScene, MotionHasTwoKeysOrMoreOfTheSameSize) {
  Scene scene = validScene();
  EXPECT_FALSE(scene.moves());
  scene.instances[0].motion.assign(1, {});
  EXPECT_TRUE(scene.moves());
  EXPECT_THROW(scene.validate(), Error);
  scene.instances[0].motion.assign(kMaxMotionKeys + 1, {});
  EXPECT_THROW(scene.validate(), Error);
  scene.instances[0].motion.assign(kMaxMotionKeys, {});
  EXPECT_NO_THROW(scene.validate());
  scene.instances[0].motion[3].ez = {};  // singular at one key
  EXPECT_THROW(scene.validate(), Error);
  scene.instances[0].motion.clear();

  Mesh& mesh = scene.meshes[0];
  mesh.motion_points.assign(2, mesh.points);
  EXPECT_NO_THROW(scene.validate());
  EXPECT_TRUE(scene.moves());
  mesh.motion_points[1].pop_back();
  EXPECT_THROW(scene.validate(), Error);
  mesh.motion_points.assign(1, mesh.points);
  EXPECT_THROW(scene.validate(), Error);
  mesh.motion_points.assign(2, mesh.points);
  mesh.motion_normals.assign(3, mesh.normals.values);
  EXPECT_THROW(scene.validate(), Error);
}

TEST(ValidateScene, LensNeedsAFocusAndExposureIsFinite) {
  Scene scene = validScene();
  scene.camera.lens_radius = 0.1f;
  scene.camera.focus_distance = 0;
  EXPECT_THROW(scene.validate(), Error);
  scene.camera.focus_distance = 2;
  EXPECT_NO_THROW(scene.validate());
  scene.camera.exposure_scale = std::numeric_limits<float>::infinity();
  EXPECT_THROW(scene.validate(), Error);
  scene.camera.exposure_scale = 1;
  scene.camera.clipping_planes.push_back({{1, 0, 0}, std::numeric_limits<float>::quiet_NaN()});
  EXPECT_THROW(scene.validate(), Error);
}

TEST(ValidateScene, LinkGroupsAreThoseThatLightsKnow) {
  Scene scene = validScene();
  Light light;
  light.lit_groups = {1, 0};
  scene.lights.push_back(light);
  EXPECT_NO_THROW(scene.validate());
  scene.meshes[0].link_group = 2;
  EXPECT_THROW(scene.validate(), Error);
}

TEST(ValidateScene, ShadersHaveSourceAndParametersNames) {
  Scene scene = validScene();
  GlslShader shader;
  shader.path = "/looks/own";
  scene.materials[0].surface_shader = shader;
  EXPECT_THROW(scene.validate(), Error);
  scene.materials[0].surface_shader->source = "void surface(in SurfacePoint point, inout Surface surface) {}";
  EXPECT_NO_THROW(scene.validate());
  scene.materials[0].surface_shader->parameters = {{"2d", "float", {}}};
  EXPECT_THROW(scene.validate(), Error);
  scene.materials[0].surface_shader->parameters = {{"size", "mat4", {}}};
  EXPECT_THROW(scene.validate(), Error);
  scene.materials[0].surface_shader->parameters = {{"size", "float", {}}, {"size", "float", {}}};
  EXPECT_THROW(scene.validate(), Error);
}

TEST(ValidateScene, AcceptsWhatIsValid) {
  EXPECT_NO_THROW(validScene().validate());
  Scene scene = validScene();  // mirrored, tiny, huge and sheared transforms can be inverted
  scene.instances[0].to_world = {{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1e9, 0, 0}};
  scene.instances.push_back({"/tiny", 0, {{1e-20, 0, 0}, {0, 1e-20, 0}, {0, 0, 1e-20}, {}}, {}, 0});
  scene.instances.push_back({"/huge", 0, {{1e20, 0, 0}, {0, 1e20, 0}, {0, 0, 1e20}, {}}, {}, 0});
  scene.instances.push_back({"/sheared", 0, {{1, 0, 0}, {1000, 1, 0}, {0, 0, 1}, {}}, {}, 0});
  EXPECT_NO_THROW(scene.validate());
}

TEST(ValidateScene, NamesBadPlacement) {
  expectSceneErrors({
      {[](Scene& s) { s.instances[0].prototype = 1; }, {"/world/quads", "index 1", "prototypes number 1"}},
      {[](Scene& s) { s.prototypes[0].meshes = {7}; }, {"/world/quads", "index 7", "meshes number 1"}},
      {[](Scene& s) { s.instances[0].shading_rate[1] = 300; },
       {"/world/quads.primvars:encore:shadingRate:reflection", "300"}},
      {[](Scene& s) { s.instances[0].primvars = {{1, true, {}}}; },
       {"/world/quads.primvars", "index 1", "instance primvars number 1"}},
      {[](Scene& s) { s.instances[0].primvars = {{0, true, {0, 0, kNan, 0}}}; },
       {"/world/quads.primvars:wear", "nan", "not finite"}},
      {[](Scene& s) { s.instances[0].primvars = {{0, true, {}}, {0, false, {}}}; },
       {"/world/quads.primvars:wear", "more than once"}},
      {[](Scene& s) { s.instance_primvars = {"wear", "wear"}; }, {"\"wear\"", "twice"}},
      {[](Scene& s) { s.instance_primvars = {""}; }, {"empty"}},
      {[](Scene& s) { s.instances[0].material = 1; }, {"/world/quads.material:binding", "materials number 1"}},
      {[](Scene& s) { s.instances[0].to_world.ey = {0, 0, 0}; }, {"/world/quads.xformOp:transform", "inverted"}},
      {[](Scene& s) { s.instances[0].to_world.ey = {2, 0, 0}; }, {"/world/quads.xformOp:transform", "inverted"}},
      {[](Scene& s) { s.instances[0].to_world = {{1e-20, 0, 0}, {0, 1e-20, 0}, {1e-20, 1e-20, 0}, {}}; }, {"inverted"}},
      {[](Scene& s) { s.instances[0].to_world.origin.x = double(kNan); }, {"xformOp:transform", "nan", "not finite"}},
      {[](Scene& s) { s.meshes[0].points[0].x = kNan; }, {"/world/quads.points", "at 0"}},
      {[](Scene& s) { s.materials.clear(); }, {"no material"}},
  });
}

TEST(ValidateScene, WantsAPlacedFace) {
  expectSceneErrors({
      {[](Scene& s) { s.instances.clear(); }, {"no renderable prim"}},
      {[](Scene& s) { s.prototypes[0].meshes.clear(); }, {"no renderable prim"}},
      {[](Scene& s) { s.meshes[0].hole_indices = {0, 1, 0}; }, {"no renderable prim"}},
      {[](Scene& s) { s.meshes = {Mesh{}}; }, {"no renderable prim"}},
  });
}

TEST(ValidateScene, NamesBadMaterialsAndTextures) {
  expectSceneErrors({
      {[](Scene& s) { s.materials[0].nodes[0].texture = 1; }, {"/looks/ground/image.inputs:file", "textures number 1"}},
      {[](Scene& s) { s.materials[0].nodes[1].scale[2] = kNan; }, {"/looks/ground/mask.inputs:scale", "nan"}},
      {[](Scene& s) { s.materials[0].nodes[1].st_transform[5] = kInfinity; }, {"/looks/ground/mask.inputs:st", "inf"}},
      {[](Scene& s) { s.materials[0].diffuse_color.node = 2; }, {"/looks/ground.inputs:diffuseColor", "index 2"}},
      {[](Scene& s) { s.materials[0].diffuse_color.channel = 2; }, {"inputs:diffuseColor", "channel 2"}},
      {[](Scene& s) { s.materials[0].roughness.channel = 4; }, {"inputs:roughness", "channel 4"}},
      {[](Scene& s) { s.materials[0].metallic.value = kNan; }, {"/looks/ground.inputs:metallic", "nan"}},
      {[](Scene& s) { s.textures[0].rgba.pop_back(); }, {"ground.png", "2 × 1", "7 numbers"}},
      {[](Scene& s) { s.textures[0].width = 0; }, {"ground.png", "0 × 1"}},
      {[](Scene& s) { s.textures[0].rgba[4] = kNan; }, {"ground.png", "column 1, row 0"}},
  });
}

TEST(ValidateScene, NamesBadLightsAndCamera) {
  expectSceneErrors({
      {[](Scene& s) { s.lights[0].radiance.y = kInfinity; }, {"/lights/key.inputs:intensity", "inf"}},
      {[](Scene& s) { s.lights[0].half_u = {0, 0, 0}; }, {"/lights/key.inputs:width", "(0, 0, 0)"}},
      {[](Scene& s) { s.lights[0].kind = Light::Kind::Sphere, s.lights[0].radius = 0; }, {"inputs:radius", "0"}},
      {[](Scene& s) { s.lights[0].kind = Light::Kind::Distant, s.lights[0].direction = {0, 0, 0}; },
       {"/lights/key.xformOp:transform", "(0, 0, 0)"}},
      {[](Scene& s) { s.lights[0].kind = Light::Kind::Distant, s.lights[0].angle_radians = 7; }, {"inputs:angle", "7"}},
      {[](Scene& s) { s.lights[0].centre.x = double(kNan); }, {"/lights/key.xformOp:transform", "nan"}},
      {[](Scene& s) { s.lights[0].diffuse = kNan; }, {"/lights/key.inputs:diffuse", "nan"}},
      {[](Scene& s) { s.camera.to_world.ex = {0, 0, 0}; }, {"/camera.xformOp:transform", "inverted"}},
      {[](Scene& s) { s.camera.half_tangent.y = 0; }, {"/camera.horizontalAperture", "(0.5, 0)"}},
      {[](Scene& s) { s.camera.centre_tangent.x = kNan; }, {"/camera.horizontalApertureOffset", "nan"}},
      {[](Scene& s) { s.camera.near_clip = 2, s.camera.far_clip = 1; }, {"/camera.clippingRange", "(2, 1)"}},
      {[](Scene& s) { s.camera.far_clip = kInfinity; }, {"/camera.clippingRange", "inf"}},
  });
}

TEST(ValidateSettings, DefaultsAreValid) { EXPECT_NO_THROW(Settings{}.validate()); }

TEST(ValidateSettings, NamesFieldValueAndRange) {
  const std::vector<Breakage<Settings>> breakages = {
      {[](Settings& s) { s.method = Method(99); }, {"method", "99", "reuse"}},
      {[](Settings& s) { s.width = 0; }, {"width", "value 0", "from 1 to 65536"}},
      {[](Settings& s) { s.height = 65537; }, {"height", "65537"}},
      {[](Settings& s) { s.samples = 0; }, {"samples", "value 0", "from 1 to 64"}},
      {[](Settings& s) { s.samples = 65; }, {"samples", "65"}},
      {[](Settings& s) { s.shading_rate = 0; }, {"shading_rate", "above 0"}},
      {[](Settings& s) { s.shading_rate = 257; }, {"shading_rate", "256"}},
      {[](Settings& s) { s.shading_rate = kNan; }, {"shading_rate", "nan"}},
      {[](Settings& s) { s.shading_rate_reflection = 257; }, {"shading_rate_reflection", "257"}},
      {[](Settings& s) { s.shading_rate_refraction = -1; }, {"shading_rate_refraction", "-1"}},
      {[](Settings& s) { s.search = Search(7); }, {"search", "7"}},
      {[](Settings& s) { s.footprint_reuse = FootprintReuse(7); }, {"footprint_reuse", "octaves"}},
      {[](Settings& s) { s.footprint_reuse = FootprintReuse::Metric, s.search = Search::Cells; }, {"search", "metric"}},
      {[](Settings& s) { s.footprint_weight = 0; }, {"footprint_weight", "above 0"}},
      {[](Settings& s) { s.max_reuse_distance = kNan; }, {"max_reuse_distance", "nan"}},
      {[](Settings& s) { s.max_bounces = 257; }, {"max_bounces", "257"}},
      {[](Settings& s) { s.filter = FilterKind(-1); }, {"filter", "-1", "gaussian"}},
      {[](Settings& s) { s.filter_radius_pixels = 0.49f; }, {"filter_radius_pixels", "0.49", "0.5 to 8"}},
      {[](Settings& s) { s.filter_radius_pixels = kNan; }, {"filter_radius_pixels", "nan"}},
      {[](Settings& s) { s.target_edge_length_world = -1; }, {"target_edge_length_world", "-1"}},
      {[](Settings& s) { s.max_micropolygons = 0; }, {"max_micropolygons", "value 0"}},
      {[](Settings& s) { s.light_samples = 0; }, {"light_samples", "value 0"}},
      {[](Settings& s) { s.occlusion_samples = 0; }, {"occlusion_samples", "value 0"}},
      {[](Settings& s) { s.reuse_tile_pixels = 100; }, {"reuse_tile_pixels", "100", "multiple of 16"}},
      {[](Settings& s) { s.reuse_tile_pixels = 0; }, {"reuse_tile_pixels", "value 0"}},
      {[](Settings& s) { s.threads = 100000; }, {"threads", "100000"}},
      {[](Settings& s) { s.roughness_limit = 1.5f; }, {"roughness_limit", "1.5", "from 0 to 1"}},
  };
  expectErrors<Settings>({}, ErrorKind::Setting, [](const Settings& settings) { settings.validate(); }, breakages);
}

TEST(Rebase, MovesInstancesLightsAndCameraButNotPrototypes) {
  Scene scene = validScene();
  const Vec3d far_away{1e9 + 0.125, -3e8, 7};
  scene.instances[0].to_world.origin = far_away + Vec3d{1, 2, 3};
  scene.lights[0].centre = far_away;
  scene.camera.to_world.origin = far_away - Vec3d{0, 0, 5};
  const std::vector<Vec3f> points = scene.meshes[0].points;

  rebase(scene, far_away);

  EXPECT_EQ(scene.instances[0].to_world.origin, (Vec3d{1, 2, 3}));  // exact: subtracted in double
  EXPECT_EQ(scene.lights[0].centre, (Vec3d{0, 0, 0}));
  EXPECT_EQ(scene.camera.to_world.origin, (Vec3d{0, 0, -5}));
  EXPECT_EQ(scene.instances[0].to_world.ex, (Vec3d{1, 0, 0}));
  EXPECT_EQ(scene.meshes[0].points, points);
}

}  // namespace
}  // namespace encore
