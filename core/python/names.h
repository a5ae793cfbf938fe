// USD's and the settings' names of core's enumerations.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "core/scene/camera.h"
#include "core/scene/error.h"
#include "core/scene/light.h"
#include "core/scene/material.h"
#include "core/scene/mesh.h"
#include "core/scene/settings.h"

namespace encore::python {

template <class E, size_t N>
using Names = std::array<std::pair<std::string_view, E>, N>;

inline constexpr Names<SubdivisionScheme, 4> kSchemes{{{"none", SubdivisionScheme::None},
                                                       {"catmullClark", SubdivisionScheme::CatmullClark},
                                                       {"loop", SubdivisionScheme::Loop},
                                                       {"bilinear", SubdivisionScheme::Bilinear}}};
inline constexpr Names<InterpolateBoundary, 3> kBoundaries{{{"none", InterpolateBoundary::None},
                                                            {"edgeOnly", InterpolateBoundary::EdgeOnly},
                                                            {"edgeAndCorner", InterpolateBoundary::EdgeAndCorner}}};
inline constexpr Names<FaceVaryingInterpolation, 6> kFaceVarying{
    {{"none", FaceVaryingInterpolation::None},
     {"cornersOnly", FaceVaryingInterpolation::CornersOnly},
     {"cornersPlus1", FaceVaryingInterpolation::CornersPlus1},
     {"cornersPlus2", FaceVaryingInterpolation::CornersPlus2},
     {"boundaries", FaceVaryingInterpolation::Boundaries},
     {"all", FaceVaryingInterpolation::All}}};
inline constexpr Names<TriangleSubdivision, 2> kTriangleSubdivisions{
    {{"catmullClark", TriangleSubdivision::CatmullClark}, {"smooth", TriangleSubdivision::Smooth}}};
inline constexpr Names<Shape, 3> kShapes{
    {{"faces", Shape::Faces}, {"curves", Shape::Curves}, {"points", Shape::Points}}};
inline constexpr Names<CurveBasis, 4> kCurveBases{{{"linear", CurveBasis::Linear},
                                                   {"bezier", CurveBasis::Bezier},
                                                   {"bspline", CurveBasis::BSpline},
                                                   {"catmullRom", CurveBasis::CatmullRom}}};
inline constexpr Names<CurveWrap, 3> kCurveWraps{
    {{"nonperiodic", CurveWrap::Nonperiodic}, {"periodic", CurveWrap::Periodic}, {"pinned", CurveWrap::Pinned}}};
inline constexpr Names<Interpolation, 5> kInterpolations{{{"constant", Interpolation::Constant},
                                                          {"uniform", Interpolation::Uniform},
                                                          {"vertex", Interpolation::Vertex},
                                                          {"varying", Interpolation::Varying},
                                                          {"faceVarying", Interpolation::FaceVarying}}};
inline constexpr Names<PatternNode::Kind, 3> kNodeKinds{{{"texture", PatternNode::Kind::Texture},
                                                         {"displayColor", PatternNode::Kind::DisplayColor},
                                                         {"primvar", PatternNode::Kind::Primvar}}};
inline constexpr Names<OpacityMode, 2> kOpacityModes{
    {{"transparent", OpacityMode::Transparent}, {"presence", OpacityMode::Presence}}};
inline constexpr Names<DomeFormat, 4> kDomeFormats{{{"latlong", DomeFormat::LatLong},
                                                    {"mirroredBall", DomeFormat::MirroredBall},
                                                    {"angular", DomeFormat::Angular},
                                                    {"cubeMapVerticalCross", DomeFormat::CubeMapVerticalCross}}};
inline constexpr Names<Camera::Projection, 2> kProjections{
    {{"perspective", Camera::Projection::Perspective}, {"orthographic", Camera::Projection::Orthographic}}};
inline constexpr Names<GlassShadows, 2> kGlassShadows{
    {{"transmit", GlassShadows::Transmit}, {"opaque", GlassShadows::Opaque}}};
inline constexpr Names<WrapMode, 4> kWrapModes{{{"black", WrapMode::Black},
                                                {"clamp", WrapMode::Clamp},
                                                {"repeat", WrapMode::Repeat},
                                                {"mirror", WrapMode::Mirror}}};
inline constexpr Names<Light::Kind, 7> kLightKinds{{{"distant", Light::Kind::Distant},
                                                    {"rect", Light::Kind::Rect},
                                                    {"disk", Light::Kind::Disk},
                                                    {"sphere", Light::Kind::Sphere},
                                                    {"cylinder", Light::Kind::Cylinder},
                                                    {"mesh", Light::Kind::Mesh},
                                                    {"dome", Light::Kind::Dome}}};
inline constexpr Names<Method, 5> kMethods{{{"reuse", Method::Reuse},
                                            {"reference", Method::Reference},
                                            {"decoupled", Method::Decoupled},
                                            {"decoupled-pixel", Method::DecoupledPixel},
                                            {"vertex", Method::Vertex}}};
inline constexpr Names<Search, 4> kSearches{
    {{"auto", Search::Auto}, {"tree", Search::Tree}, {"groups", Search::Groups}, {"cells", Search::Cells}}};
inline constexpr Names<FootprintReuse, 3> kFootprintReuses{
    {{"ignore", FootprintReuse::Ignore}, {"metric", FootprintReuse::Metric}, {"octaves", FootprintReuse::Octaves}}};
inline constexpr Names<FilterKind, 4> kFilters{{{"box", FilterKind::Box},
                                                {"gaussian", FilterKind::Gaussian},
                                                {"mitchell", FilterKind::Mitchell},
                                                {"blackman-harris", FilterKind::BlackmanHarris}}};
inline constexpr Names<Aov::Kind, 7> kAovKinds{{{"position", Aov::Kind::Position},
                                                {"eyePosition", Aov::Kind::EyePosition},
                                                {"eyeNormal", Aov::Kind::EyeNormal},
                                                {"primvar", Aov::Kind::Primvar},
                                                {"primId", Aov::Kind::PrimId},
                                                {"instanceId", Aov::Kind::InstanceId},
                                                {"elementId", Aov::Kind::ElementId}}};
inline constexpr Names<ErrorKind, 6> kErrorKinds{{{"scene", ErrorKind::Scene},
                                                  {"setting", ErrorKind::Setting},
                                                  {"device", ErrorKind::Device},
                                                  {"memory", ErrorKind::Memory},
                                                  {"cancelled", ErrorKind::Cancelled},
                                                  {"internal", ErrorKind::Internal}}};

// The names of an enumeration that settings and dictionaries hold.
constexpr const auto& namesOf(PatternNode::Kind) { return kNodeKinds; }
constexpr const auto& namesOf(OpacityMode) { return kOpacityModes; }
constexpr const auto& namesOf(DomeFormat) { return kDomeFormats; }
constexpr const auto& namesOf(Camera::Projection) { return kProjections; }
constexpr const auto& namesOf(GlassShadows) { return kGlassShadows; }
constexpr const auto& namesOf(WrapMode) { return kWrapModes; }
constexpr const auto& namesOf(Light::Kind) { return kLightKinds; }
constexpr const auto& namesOf(Method) { return kMethods; }
constexpr const auto& namesOf(Search) { return kSearches; }
constexpr const auto& namesOf(FootprintReuse) { return kFootprintReuses; }
constexpr const auto& namesOf(FilterKind) { return kFilters; }
constexpr const auto& namesOf(Aov::Kind) { return kAovKinds; }

// The value called `name`. Throws Error(error_kind) at `where` that lists the names there are.
template <class E, size_t N>
E fromName(const Names<E, N>& names, std::string_view name, const std::string& where,
           ErrorKind error_kind = ErrorKind::Scene) {
  std::string choices;
  for (const auto& [known, value] : names) {
    if (known == name) return value;
    choices += (choices.empty() ? "" : ", ") + std::string(known);
  }
  throw Error(error_kind, "'" + std::string(name) + "' is not a choice", where, "Choose one of: " + choices);
}

template <class E, size_t N>
std::string toName(const Names<E, N>& names, E value) {
  for (const auto& [name, known] : names)
    if (known == value) return std::string(name);
  return "?";
}

}  // namespace encore::python
