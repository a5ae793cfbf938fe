// Shaders of the user's own: what they are given, what they set, and what is said when they are wrong.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/pattern/glsl_source.h"
#include "core/scene/error.h"
#include "tests/core/pattern_world.h"
#include "tests/core/twins/texture_twin.h"

namespace encore {
namespace {

using Kind = PointSlot::Kind;

GlslParameter constantParameter(const std::string& name, const std::string& type, Vec4f value) {
  GlslParameter parameter{name, type, {}};
  parameter.input.value = value;
  return parameter;
}
GlslParameter nodeParameter(const std::string& name, const std::string& type, int32_t node, int32_t channel = 0) {
  GlslParameter parameter{name, type, {}};
  parameter.input.node = node, parameter.input.channel = channel;
  return parameter;
}

Material shaded(const std::string& source, std::vector<GlslParameter> parameters = {}) {
  Material material;
  material.path = "/looks/own";
  material.surface_shader = GlslShader{"/looks/own/surface", "own.glsl", source, std::move(parameters)};
  return material;
}
Material displaced(const std::string& source, std::vector<GlslParameter> parameters = {}) {
  Material material;
  material.path = "/looks/own";
  material.displacement_shader = GlslShader{"/looks/own/displacement", "own.glsl", source, std::move(parameters)};
  return material;
}

std::vector<Kind> kinds(const PointLayout& layout) {
  std::vector<Kind> result;
  for (const PointSlot& slot : layout.slots) result.push_back(slot.kind);
  return result;
}

class GlslShaderTest : public PatternTest {
 protected:
  static Error errorOf(const Scene& scene) {
    try {
      Patterns patterns(*device, scene);
    } catch (const Error& error) {
      return error;
    }
    return Error(ErrorKind::Internal, "nothing thrown");
  }
  static void expectError(const Scene& scene, const std::string& where, const std::string& words) {
    const Error error = errorOf(scene);
    EXPECT_EQ(error.kind(), ErrorKind::Scene) << error.what();
    EXPECT_EQ(error.where(), where);
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
};

TEST(GlslSource, FindsIdentifiersOutsideOfComments) {
  const GlslSource source(
      "// roughness\n/* metallic\nmetallic */ void surface(in SurfacePoint p, inout Surface s) {\n"
      "  s.ior = 1.0e2; // opacity\n  s.clear\\\ncoat = 1.0f;\n}\n");
  EXPECT_TRUE(source.mentions("ior") && source.mentions("surface") && source.mentions("clearcoat"));
  for (const char* name : {"roughness", "metallic", "opacity", "clear", "coat", "e2", "f"})
    EXPECT_FALSE(source.mentions(name)) << name;
}

TEST(GlslSource, WholeStructsMentionEverything) {
  for (const char* text : {"Surface a = Surface(x);", "SurfacePoint /**/ (x)", "#define S Surface\n", "a ## b",
                           "Surface[2] a;", "#include \"x\"\n", "DisplacementPoint\n(x)"})
    EXPECT_TRUE(GlslSource(text).mentions("whatever")) << text;
  for (const char* text : {"void f(inout Surface s)", "const SurfacePoint p = q;", "int Surfaces(); // Surface("})
    EXPECT_FALSE(GlslSource(text).mentions("whatever")) << text;
}

TEST(GlslSource, ListsMacros) {
  const GlslSource source(
      "#define A 1\n  # define  B(x) x\n/**/#define C\n// #define D\nint a; int E;\n#undef A\n#define F \\\n2\n");
  EXPECT_EQ(source.macros(), (std::vector<std::string>{"A", "B", "C", "F"}));
}

TEST_F(GlslShaderTest, IsGivenThePointAndSetsTheInputs) {
  Scene scene;
  scene.materials = {
      shaded("void surface(in SurfacePoint p, inout Surface s) {\n"
             "  s.diffuseColor = p.position + 10.0 * p.objectPosition;\n"
             "  s.emissiveColor = vec3(p.st + p.dstdx, p.dstdy.y) + p.displayColor;\n"
             "  s.roughness = p.uv.x; s.clearcoat = p.uv.y; s.opacity = p.normal.x; s.ior = s.ior + 1.0;\n"
             "  s.normal = p.normal;\n"
             "}\n")};
  scene.materials[0].metallic.value = 0.125f;
  Patterns patterns(*device, scene);
  const std::vector<TestPoint> points{{.material = 0,
                                       .st = {0.5f, 0.25f},
                                       .dstdx = {1, 2},
                                       .dstdy = {3, 4},
                                       .color = {0.125f, 0.25f, 0.5f},
                                       .position = {1, 2, 3},
                                       .object_position = {4, 5, 6},
                                       .normal = {0.5f, -0.5f, 0.75f},
                                       .uv = {0.125f, 0.375f}}};
  const ShadingInputs shading = evaluate<ShadingInputs>(patterns, PatternPart::Shading, points)[0];
  EXPECT_EQ(shading.diffuse_color, (Vec3f{41, 52, 63}));
  EXPECT_EQ(shading.emissive_color, (Vec3f{1.625f, 2.5f, 4.5f}));
  const PathInputs path = evaluate<PathInputs>(patterns, PatternPart::Path, points)[0];
  EXPECT_EQ(path.base_color, (Vec3f{41, 52, 63}));
  EXPECT_EQ(path.metallic, 0.125f);
  EXPECT_EQ(path.roughness, 0.125f);
  EXPECT_EQ(path.clearcoat, 0.375f);
  EXPECT_EQ(path.clearcoat_roughness, 0.01f);
  EXPECT_EQ(path.opacity, 0.5f);
  EXPECT_EQ(path.ior, 2.5f);
  EXPECT_EQ(path.normal, (Vec3f{0.5f, -0.5f, 0.75f}));
  EXPECT_EQ(evaluate<OpacityInputs>(patterns, PatternPart::Opacity, points)[0].opacity, 0.5f);
  EXPECT_EQ(patterns.normalTexcoord(0), "st");
  EXPECT_TRUE(patterns.readsTextures());
}

TEST_F(GlslShaderTest, PartsVaryWithWhatTheSourceNames) {
  Scene scene;
  scene.materials = {shaded("void surface(in SurfacePoint p, inout Surface s) { s.diffuseColor = p.position; }"),
                     shaded("void surface(in SurfacePoint p, inout Surface s) { s.roughness = p.st.x; }"),
                     shaded("void surface(in SurfacePoint p, inout Surface s) { s.opacity = 0.5; }"),
                     shaded("void surface(in SurfacePoint p, inout Surface s) {}")};
  scene.materials[0].surface_shader->path = "/a";
  const Patterns patterns(*device, scene);
  const bool expected[4][4] = {{true, false, false, false},
                               {false, true, false, false},
                               {false, true, true, false},
                               {false, false, false, false}};
  for (int32_t m = 0; m < 4; ++m)
    for (uint32_t part = 0; part < kPatternParts; ++part)
      EXPECT_EQ(patterns.varies(PatternPart(part), m), expected[m][part]) << m << " " << part;
  EXPECT_EQ(kinds(patterns.layout(PatternPart::Shading, 0)), std::vector<Kind>{Kind::Position});
  EXPECT_EQ(kinds(patterns.layout(PatternPart::Path, 1)), std::vector<Kind>{Kind::Texcoord});
  EXPECT_TRUE(kinds(patterns.layout(PatternPart::Path, 2)).empty());
  EXPECT_EQ(patterns.normalTexcoord(0), "");
  EXPECT_EQ(patterns.constantPath(0).roughness, 0.5f);

  // Metals reflect with the base colour, so that paths ask for it.
  scene.materials[0].metallic.value = 1;
  EXPECT_TRUE(Patterns(*device, scene).varies(PatternPart::Path, 0));
  scene.materials[0].use_specular_workflow = true;
  EXPECT_FALSE(Patterns(*device, scene).varies(PatternPart::Path, 0));
}

// Batches without floats of their own must work too.
TEST_F(GlslShaderTest, NeedsNoInputs) {
  Scene scene;
  scene.materials = {shaded("void surface(in SurfacePoint p, inout Surface s) { s.opacity = 0.5; }")};
  Patterns patterns(*device, scene);
  EXPECT_EQ(evaluate<OpacityInputs>(patterns, PatternPart::Opacity, {TestPoint{}})[0].opacity, 0.5f);
}

TEST_F(GlslShaderTest, TakesParametersOfAllTypes) {
  Scene scene;
  scene.textures = {constantTexture(1, 1, {0.25f, 0.5f, 0.75f, 1})};
  scene.materials = {
      shaded("void surface(in SurfacePoint point, inout Surface s) {\n"
             "  s.diffuseColor = vec3(a, b.x + b.y, float(n));\n"
             "  s.emissiveColor = c + d.xyz * d.w + e;\n"
             "}\n",
             {constantParameter("a", "float", {0.1f, 0, 0, 0}), constantParameter("b", "vec2", {0.25f, 0.5f, 0, 0}),
              constantParameter("c", "vec3", {1, 2, 3, 0}), constantParameter("d", "vec4", {1, 2, 3, 2}),
              constantParameter("n", "int", {-7, 0, 0, 0}), nodeParameter("e", "vec3", 0)})};
  scene.materials[0].nodes = {textureNode(0)};
  const ShadingInputs value = PatternTest::evaluate(scene, {TestPoint{}})[0];
  EXPECT_EQ(value.diffuse_color, (Vec3f{0.1f, 0.75f, -7}));
  EXPECT_EQ(value.emissive_color, (Vec3f{3.25f, 6.5f, 9.75f}));
}

// Names of parameters, functions, structs and macros that generated code and shaders/pattern use themselves.
TEST_F(GlslShaderTest, NamesDoNotCollide) {
  Scene scene;
  scene.textures = {constantTexture(1, 1, {0.25f, 0.5f, 0.75f, 1})};
  std::string source, sum = "0.0";
  for (const char* name :
       {"kBlockPixels",    "kBlockArea",       "kNoInstance",    "kShadeNotFound", "kShadeNone",  "finite",
        "read2",           "kWrapBlack",       "kWrapClamp",     "kWrapRepeat",    "kWrapMirror", "kMaxAnisotropy",
        "kMaxFootprint",   "kMaxTapsAlong",    "clampFootprint", "foldCoordinate", "wrapTexel",   "fetchTexel",
        "sampleLevel",     "makeFootprint",    "wantedLevel",    "sampleTexture",  "tileAt",      "udimTile",
        "evaluateTexture", "evaluateMaterial", "points",         "values",         "order",       "textures",
        "nodes",           "tables",           "count",          "ordered"}) {
    source += std::string("float ") + name + "(float x) { return x + 1.0; }\n";
    sum = std::string(name) + "(" + sum + ")";
  }
  for (const char* name :
       {"SurfaceKey", "PatternPoint",  "ShadingInputs",    "PathInputs",   "OpacityInputs", "DisplacementInputs",
        "Floats",     "Texels",        "MipLevel",         "MipLevels",    "TextureTile",   "TextureTiles",
        "LevelMarks", "TextureTables", "TextureNode",      "TextureNodes", "Footprint",     "Points",
        "Order",      "Values",        "MaterialTextures", "Arguments"})
    source += std::string("struct ") + name + " { int mine; };\n";
  source += "float finiteOr(float a, float b) { return 77.0; }\n";
  source += "#define OUTPUTS 3\n#define TEXTURE_SLOTS 99\n#define TAPS_ACROSS 7\n#define level 5\n#define vec4 what\n";
  source += "void surface(in SurfacePoint q, inout Surface s) { s.diffuseColor = vec3(" + sum +
            ", first + point + before, after + texel + range + material + value); }\n";
  Material material = shaded(source);
  material.nodes = {textureNode(0)};
  for (const char* name : {"first", "point", "before", "after", "texel", "range", "material", "value", "data", "read3"})
    material.surface_shader->parameters.push_back(nodeParameter(name, "float", 0));
  material.surface_shader->parameters.push_back(constantParameter("group", "float", {}));
  scene.materials = {material};
  EXPECT_EQ(errorOf(scene).what(), std::string("nothing thrown"));
  const ShadingInputs value = PatternTest::evaluate(scene, {TestPoint{}})[0];
  EXPECT_EQ(value.diffuse_color, (Vec3f{34, 0.75f, 1.25f}));
}

// Equal names in several shaders, one source for several materials, and materials without shaders, in one batch.
TEST_F(GlslShaderTest, MaterialsCoexist) {
  Scene scene;
  scene.textures = {randomTexture(9, 7, 3)};
  const std::vector<twin::Level> pyramid = twin::pyramid(scene.textures[0]);
  const std::string shared =
      "#define STEP 2.0\nstruct Thing { float a; };\nfloat helper(float x) { return x * STEP; }\n"
      "void surface(in SurfacePoint p, inout Surface s) { s.diffuseColor = vec3(helper(amount), base.rg); }\n";
  const std::string other =
      "#define STEP 3.0\nstruct Thing { vec3 a; };\nvec3 helper(float x) { return vec3(x) * STEP; }\n"
      "void surface(in SurfacePoint p, inout Surface s) { s.diffuseColor = helper(p.uv.x) + s.diffuseColor; }\n";
  for (uint32_t m = 0; m < 40; ++m) {
    const float value = float(m);
    if (m % 4 == 0) {
      scene.materials.push_back(showing(textureNode(0)));
    } else if (m % 4 == 3) {
      scene.materials.push_back(shaded(other));
      scene.materials.back().diffuse_color.value = {value, 0, 0};
    } else {
      Material material = shaded(shared, {constantParameter("amount", "float", {value, 0, 0, 0}),
                                          constantParameter("base", "vec3", {value, 1, 2, 0})});
      if (m % 4 == 1) {
        material.nodes = {textureNode(0)};
        material.surface_shader->parameters[1] = nodeParameter("base", "vec3", 0);
      }
      scene.materials.push_back(material);
    }
  }
  EXPECT_EQ(generatePatterns(scene).parts[0].size(), 3u);
  Random random(5);
  std::vector<TestPoint> points;
  for (uint32_t i = 0; i < 4000; ++i) {
    points.push_back(randomPoint(random.below(40), random));
    points.back().uv.x = random.unit();
  }
  const std::vector<ShadingInputs> values = PatternTest::evaluate(scene, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const TestPoint& p = points[i];
    const float m = float(p.material);
    const twin::Texel texel = twin::evaluate(pyramid, textureNode(0), p.st, p.dstdx, p.dstdy);
    const double bound = 3 * (0x1p-11 + 2e-4);
    const Vec3f found = values[i].diffuse_color;
    if (p.material % 4 == 0) {
      ASSERT_NEAR(found.x, texel[0], bound) << i;
    } else if (p.material % 4 == 3) {
      ASSERT_EQ(found, (Vec3f{p.uv.x * 3 + m, p.uv.x * 3, p.uv.x * 3})) << i;
    } else if (p.material % 4 == 1) {
      ASSERT_EQ(found.x, 2 * m) << i;
      ASSERT_NEAR(found.y, texel[0], bound) << i;
      ASSERT_NEAR(found.z, texel[1], bound) << i;
    } else {
      ASSERT_EQ(found, (Vec3f{2 * m, m, 1})) << i;
    }
  }
}

TEST_F(GlslShaderTest, InputsKeepTheirNetworks) {
  Scene scene;
  scene.textures = {constantTexture(1, 1, {0.25f, 0.5f, 0.75f, 1})};
  Material material =
      shaded("void surface(in SurfacePoint p, inout Surface s) { s.emissiveColor = 2.0 * s.diffuseColor; }");
  material.nodes = {textureNode(0)};
  material.diffuse_color.node = 0;
  scene.materials = {material};
  const ShadingInputs value = PatternTest::evaluate(scene, {TestPoint{}})[0];
  EXPECT_EQ(value.diffuse_color, (Vec3f{0.25f, 0.5f, 0.75f}));
  EXPECT_EQ(value.emissive_color, (Vec3f{0.5f, 1, 1.5f}));
}

TEST_F(GlslShaderTest, WhatIsNotFiniteKeepsItsValue) {
  Scene scene;
  Material material = shaded(
      "void surface(in SurfacePoint p, inout Surface s) {\n"
      "  s.diffuseColor = vec3(1.0 / p.uv.x, sqrt(p.uv.x - 1.0), 0.5);\n"
      "  s.emissiveColor = vec3(0.0);\n}\n");
  scene.materials = {material};
  std::vector<TestPoint> points(1);
  points[0].uv = {0, 0};
  EXPECT_EQ(PatternTest::evaluate(scene, points)[0].diffuse_color, (Vec3f{0.18f, 0.18f, 0.5f}));
}

TEST_F(GlslShaderTest, Displaces) {
  Scene scene;
  scene.textures = {constantTexture(1, 1, {0.25f, 0.5f, 0.75f, 1})};
  Material material = displaced(
      "void displacement(in DisplacementPoint p, inout vec3 offset, inout float along_normal) {\n"
      "  offset = p.position + p.normal; along_normal += scale * p.uv.y + height;\n}\n",
      {constantParameter("scale", "float", {4, 0, 0, 0}), nodeParameter("height", "float", 0, 1)});
  material.nodes = {textureNode(0)};
  material.displacement.value = 100;
  scene.materials = {material, displaced("void displacement(in DisplacementPoint p, inout vec3 o, inout float a) {}")};
  Patterns patterns(*device, scene);
  EXPECT_EQ(kinds(patterns.layout(PatternPart::Displacement, 0)),
            (std::vector<Kind>{Kind::ObjectPosition, Kind::Normal, Kind::Parameter, Kind::Texcoord}));
  for (PatternPart part : {PatternPart::Shading, PatternPart::Path, PatternPart::Opacity})
    EXPECT_FALSE(patterns.varies(part, 0));
  EXPECT_FALSE(patterns.readsTextures());  // footprints of pixels do not matter
  const auto value = evaluate<DisplacementInputs>(patterns, PatternPart::Displacement, {TestPoint{}})[0];
  EXPECT_EQ(value.offset, (Vec3f{4, 5, 7}));
  EXPECT_EQ(value.along_normal, 103.5f);
}

TEST_F(GlslShaderTest, ErrorsNameThePrimTheLineAndTheReason) {
  Scene scene;
  scene.materials = {
      shaded("void surface(in SurfacePoint p, inout Surface s) { s.ior = 2.0; }"),
      shaded("// fine\n\nvoid surface(in SurfacePoint p, inout Surface s) {\n  s.ior = no_such_name;\n}\n")};
  scene.materials[1].surface_shader->path = "/looks/broken/surface";
  expectError(scene, "/looks/broken/surface", "own.glsl:4: 'no_such_name' : undeclared identifier");

  const auto broken = [&](const std::string& source, const std::string& words) {
    scene.materials[1].surface_shader->source = source;
    expectError(scene, "/looks/broken/surface", words);
  };
  const std::string head = "void surface(in SurfacePoint p, inout Surface s) {\n";
  broken(head + "  s.colour = vec3(1);\n}\n", "own.glsl:2: 'colour'");
  broken(head + "  s.ior = 1.0\n}\n", "own.glsl:3: '' :  syntax error");
  broken(head + "  s.ior = vec3(1);\n}\n", "own.glsl:2: 'assign'");
  broken(head + "}\n}\n", "own.glsl:3:");
  broken(head, "own.glsl, after its end:");
  broken("", "own.glsl, after its end: 'surface' : no matching overloaded function found");
  broken("", "must define void surface(in SurfacePoint, inout Surface)");
  broken("float surface() { return 1.0; }\n", "no matching overloaded function");
  broken(head + "}\nvoid main() {}\n", "main");
  broken("#if 1\n" + head + "}\n", "missing #endif");
  broken("#error nonsense\n", "own.glsl:1: '#error' : nonsense");
  broken("#version 330\n", "own.glsl:1: '#version'");
  broken("/* open\n", "own.glsl");
  broken("void surface(in SurfacePoint p, inout Surface s) { surface(p, s); s.ior = 1.0; }\n", "ecursi");
  broken("void surface(in SurfacePoint p, inout Surface s);\n// ior", "surface(");
  broken("#include \"secret\"\n", "secret");
}

TEST_F(GlslShaderTest, ErrorsOfDisplacement) {
  Scene scene;
  scene.materials = {displaced("\nvoid displacement(in SurfacePoint p, inout vec3 o, inout float a) {}")};
  expectError(scene, "/looks/own/displacement", "own.glsl:2:");
}

TEST_F(GlslShaderTest, ErrorsOfParameters) {
  const std::string source = "void surface(in SurfacePoint p, inout Surface s) { s.ior = 1.0; }";
  const auto broken = [&](std::vector<GlslParameter> parameters, const std::string& where, const std::string& words) {
    Scene scene;
    scene.materials = {shaded(source, std::move(parameters))};
    expectError(scene, where, words);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  broken({constantParameter("a", "float", {nan, 0, 0, 0})}, "/looks/own/surface.inputs:a", "not finite");
  broken({constantParameter("my:name", "float", {})}, "/looks/own/surface.inputs:my:name", "identifier");
  broken({constantParameter("gl_name", "float", {})}, "/looks/own/surface.inputs:gl_name", "identifier");
  broken({constantParameter("", "float", {})}, "/looks/own/surface.inputs:", "identifier");
  broken({constantParameter("a", "mat4", {})}, "/looks/own/surface.inputs:a", "mat4");
  broken({constantParameter("a", "float", {}), constantParameter("a", "int", {})}, "/looks/own/surface.inputs:a",
         "two");
  broken({constantParameter("while", "float", {})}, "/looks/own/surface", "parameter while:1:");
}

}  // namespace
}  // namespace encore
