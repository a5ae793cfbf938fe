// Settings::aovs of a frame, from first hits to the film.
#pragma once

#include <span>
#include <vector>

#include "core/film/film.h"
#include "core/path/aovs.h"

namespace encore {

class AovFilm {
 public:
  // Keeps references to all of them.
  AovFilm(const ShadeContext& context, const CameraRays& camera, Device& device);

  // Anything but what follows from the normals: addBatch() has to be called, with first hits.
  static bool needsFirstHits(const Settings& settings);

  // After Film::addDepth(), with film positions on the device.
  void addBatch(std::span<const BlockOrigin> blocks, std::span<const FirstHit> first, const FilmSamples& shared,
                Film& film);
  // What follows from the normals of a finished tile.
  void finish(FilmImages& images) const;

 private:
  const ShadeContext& context_;
  Device& device_;
  AovValues values_;
  Buffer<float> filtered_;  // of one of them at a time, per slot
};

}  // namespace encore
