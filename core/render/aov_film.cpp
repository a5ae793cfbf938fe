#include "core/render/aov_film.h"

#include <algorithm>

namespace encore {
namespace {

// Its values are those of the closest sample of each pixel.
bool isUnfiltered(const Aov& aov) { return aov.kind != Aov::Kind::EyeNormal && aov.kind != Aov::Kind::Primvar; }

}  // namespace

AovFilm::AovFilm(const ShadeContext& context, const CameraRays& camera, Device& device)
    : context_(context), device_(device), values_(context, camera) {}

bool AovFilm::needsFirstHits(const Settings& settings) {
  return std::any_of(settings.aovs.begin(), settings.aovs.end(),
                     [](const Aov& aov) { return aov.kind != Aov::Kind::EyeNormal; });
}

void AovFilm::addBatch(std::span<const BlockOrigin> blocks, std::span<const FirstHit> first, const FilmSamples& shared,
                       Film& film) {
  const std::vector<Aov>& aovs = context_.settings.aovs;
  const uint32_t per_pixel = context_.settings.samples * context_.settings.samples;
  std::vector<uint32_t> closest;
  if (std::any_of(aovs.begin(), aovs.end(), isUnfiltered)) closest = values_.closest(first, per_pixel);
  std::vector<float> values(3 * closest.size());
  std::vector<int32_t> ids(closest.size());
  for (size_t i = 0; i < aovs.size(); ++i) switch (aovs[i].kind) {
      case Aov::Kind::Position:
      case Aov::Kind::EyePosition:
        values_.positions(aovs[i], first, closest, values);
        film.setAov(i, blocks, std::span<const float>(values));
        break;
      case Aov::Kind::PrimId:
      case Aov::Kind::InstanceId:
      case Aov::Kind::ElementId:
        values_.ids(aovs[i], first, closest, ids);
        film.setAov(i, blocks, std::span<const int32_t>(ids));
        break;
      case Aov::Kind::Primvar: {
        const size_t count = first.size() * aovs[i].components;
        filtered_.reserve(device_, count, "aov");
        values_.primvar(aovs[i], first, filtered_.host().first(count));
        filtered_.toDevice(0, count);
        film.addAov(i, blocks, shared, filtered_);
        break;
      }
      case Aov::Kind::EyeNormal:
        break;
    }
}

void AovFilm::finish(FilmImages& images) const {
  for (size_t i = 0; i < images.aovs.size(); ++i) {
    if (context_.settings.aovs[i].kind != Aov::Kind::EyeNormal) continue;
    images.aovs[i].values.resize(3 * images.normal.size());
    values_.eyeNormals(images.normal, images.aovs[i].values);
  }
}

}  // namespace encore
