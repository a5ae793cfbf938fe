#include "core/shade/light_image.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/pattern/texture_pyramid.h"

namespace encore {
namespace {

constexpr uint32_t kMostRows = 2048;
constexpr double kPiDouble = 3.14159265358979323846;
// No pixel is brighter: sums and products with radiances stay finite.
constexpr float kBrightest = 1e18f;

float emitted(float x) { return x > 0 && std::isfinite(x) ? std::min(x, kBrightest) : 0; }

float brightness(Vec3f c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

// Sine and cosine of the colatitude at the lower border of a row, from the bottom.
double rowCosine(uint32_t row, uint32_t rows) { return -std::cos(kPiDouble * row / rows); }

Vec3f latLongDirection(float s, float t) {
  const float theta = kPi * (1 - t), phi = 2 * kPi * (0.5f - s), sine = std::sin(theta);
  return {sine * std::sin(phi), std::cos(theta), sine * std::cos(phi)};
}

// A face of the cross: column and row from the upper left, and the point on it in [-1, 1]², y up.
struct CrossPoint {
  int column, row;
  float x, y;
};
CrossPoint crossPoint(Vec3f d) {
  const Vec3f a = absolute(d);
  if (a.x >= a.y && a.x >= a.z) return {d.x > 0 ? 0 : 2, 1, d.z / d.x, d.y / a.x};
  if (a.y >= a.z) return {1, d.y > 0 ? 0 : 2, -d.x / a.y, -d.z / d.y};
  return d.z > 0 ? CrossPoint{1, 1, -d.x / a.z, d.y / a.z} : CrossPoint{1, 3, -d.x / a.z, -d.y / a.z};
}

// The running sums' first entry that is above x.
uint32_t findAbove(const float* sums, uint32_t count, float x) {
  return std::min(uint32_t(std::upper_bound(sums, sums + count, x) - sums), count - 1);
}

}  // namespace

Vec2f domeImagePoint(DomeFormat format, Vec3f d) {
  switch (format) {
    case DomeFormat::LatLong:
      return {0.5f - std::atan2(d.x, d.z) / (2 * kPi), 1 - std::acos(std::clamp(d.y, -1.0f, 1.0f)) * kInvPi};
    case DomeFormat::MirroredBall: {
      const float m = 2 * std::sqrt(std::max(2 + 2 * d.z, 1e-12f));
      return {0.5f + d.x / m, 0.5f + d.y / m};
    }
    case DomeFormat::Angular: {
      const float sine = std::sqrt(d.x * d.x + d.y * d.y);
      const float r = sine > 0 ? std::atan2(sine, d.z) * (0.5f * kInvPi) / sine : 0;
      return {0.5f + d.x * r, 0.5f + d.y * r};
    }
    case DomeFormat::CubeMapVerticalCross: {
      const CrossPoint c = crossPoint(d);
      return {(float(c.column) + 0.5f + 0.5f * c.x) / 3, 1 - (float(c.row) + 0.5f - 0.5f * c.y) / 4};
    }
  }
  return {};
}

LightImage::LightImage(const Texture& texture) {
  decode(texture);
  Vec3d sum;
  for (uint32_t y = 0; y < height_; ++y)
    for (uint32_t x = 0; x < width_; ++x) sum += toDouble(pixel(x, y));
  average_ = toFloat(sum / std::max(1.0, double(width_) * height_));
}

LightImage::LightImage(const Texture& texture, DomeFormat format) {
  decode(texture);
  if (format != DomeFormat::LatLong) resample(texture, format);
  wraps_ = true;
  makeDistribution();
}

void LightImage::decode(const Texture& texture) {
  width_ = texture.width, height_ = texture.height;
  const size_t count = size_t(width_) * height_;
  pixels_.resize(count * 3);
  if (texture.rgba.size() == count * 4) {
    for (size_t i = 0; i < count; ++i)
      for (size_t k = 0; k < 3; ++k) pixels_[3 * i + k] = emitted(texture.rgba[4 * i + k]);
  } else if (texture.source && count > 0) {
    std::vector<uint16_t> halves(count * 4);
    texture.source->read(halves);
    for (size_t i = 0; i < count; ++i)
      for (size_t k = 0; k < 3; ++k) pixels_[3 * i + k] = emitted(fromHalf(halves[4 * i + k]));
  }
}

void LightImage::resample(const Texture& texture, DomeFormat format) {
  const bool cross = format == DomeFormat::CubeMapVerticalCross;
  const LightImage source(texture);
  const float w = float(width_), h = float(height_);
  const uint32_t wanted = cross ? 2 * std::max(width_ / 3, height_ / 4) : std::min(width_, height_);
  const uint32_t rows = std::clamp(wanted, 1u, kMostRows);
  const auto lookup = [&](Vec3f d) {
    const Vec2f st = domeImagePoint(format, d);
    if (!cross) return source.bilinear(st.x * w, st.y * h);
    // Within the face: what is beside it in the cross may be empty.
    const CrossPoint c = crossPoint(d);
    const float x0 = w * float(c.column) / 3, y0 = h * float(3 - c.row) / 4;
    return source.bilinear(std::clamp(st.x * w, x0 + 0.5f, std::max(x0 + 0.5f, x0 + w / 3 - 0.5f)),
                           std::clamp(st.y * h, y0 + 0.5f, std::max(y0 + 0.5f, y0 + h / 4 - 0.5f)));
  };
  std::vector<float> pixels(size_t(rows) * rows * 2 * 3);
  tbb::parallel_for(0u, rows, [&](uint32_t y) {
    for (uint32_t x = 0; x < 2 * rows; ++x) {
      Vec3f sum;
      for (int k = 0; k < 4; ++k) {
        const float s = (float(x) + (k % 2 ? 0.75f : 0.25f)) / float(2 * rows);
        sum += lookup(latLongDirection(s, (float(y) + (k / 2 ? 0.75f : 0.25f)) / float(rows))) * 0.25f;
      }
      for (int k = 0; k < 3; ++k) pixels[(size_t(y) * 2 * rows + x) * 3 + size_t(k)] = sum[k];
    }
  });
  width_ = 2 * rows, height_ = rows;
  pixels_ = std::move(pixels);
}

// The average of a bilinear lookup over a pixel: 1/8, 6/8, 1/8 of it and its neighbours, in both directions. So no
// place that emits has density 0.
void LightImage::makeDistribution() {
  if (pixels_.empty()) return;
  in_row_.resize(size_t(width_) * height_);
  rows_.resize(height_);
  std::vector<Vec3d> sums(height_);
  tbb::parallel_for(0u, height_, [&](uint32_t y) {
    const auto column = [&](int64_t x) {
      return pixel(x, int64_t(y) - 1) * 0.125f + pixel(x, y) * 0.75f + pixel(x, int64_t(y) + 1) * 0.125f;
    };
    double sum = 0;
    for (uint32_t x = 0; x < width_; ++x) {
      const Vec3f mean = column(int64_t(x) - 1) * 0.125f + column(x) * 0.75f + column(int64_t(x) + 1) * 0.125f;
      sums[y] += toDouble(mean);
      sum += double(brightness(mean));
      in_row_[size_t(y) * width_ + x] = float(sum);
    }
  });
  double total = 0;
  Vec3d integral;
  for (uint32_t y = 0; y < height_; ++y) {
    const double solid_angle = double(rowSolidAngle(y));
    total += double(in_row_[size_t(y) * width_ + width_ - 1]) * solid_angle;
    integral += sums[y] * solid_angle;
    rows_[y] = float(total);
  }
  total_ = float(total);
  average_ = toFloat(integral / (4 * kPiDouble));
}

float LightImage::rowSolidAngle(uint32_t row) const {
  return float((rowCosine(row + 1, height_) - rowCosine(row, height_)) * 2 * kPiDouble / width_);
}

uint64_t LightImage::bytes() const { return (pixels_.size() + in_row_.size() + rows_.size()) * sizeof(float); }

Vec3f LightImage::pixel(int64_t x, int64_t y) const {
  const int64_t w = width_;
  x = wraps_ ? (x + w) % w : std::clamp<int64_t>(x, 0, w - 1);
  y = std::clamp<int64_t>(y, 0, int64_t(height_) - 1);
  const float* p = &pixels_[size_t(y * w + x) * 3];
  return {p[0], p[1], p[2]};
}

Vec3f LightImage::bilinear(float x, float y) const {
  if (pixels_.empty()) return {};
  // Not a number becomes 0.
  x = x > 0 ? std::min(x, float(width_)) : 0, y = y > 0 ? std::min(y, float(height_)) : 0;
  const float fx = std::floor(x - 0.5f), fy = std::floor(y - 0.5f);
  const float a = x - 0.5f - fx, b = y - 0.5f - fy;
  const int64_t i = int64_t(fx), j = int64_t(fy);
  const Vec3f low = pixel(i, j) * (1 - a) + pixel(i + 1, j) * a;
  const Vec3f high = pixel(i, j + 1) * (1 - a) + pixel(i + 1, j + 1) * a;
  return low * (1 - b) + high * b;
}

Vec3f LightImage::at(float s, float t) const { return bilinear(s * float(width_), t * float(height_)); }

Vec3f LightImage::towards(Vec3f direction) const {
  const Vec2f st = domeImagePoint(DomeFormat::LatLong, direction);
  return at(st.x, st.y);
}

Vec3f LightImage::sample(Vec2f u) const {
  const float along = u.y * total_;
  const uint32_t y = findAbove(rows_.data(), height_, along);
  const float before = y > 0 ? rows_[y - 1] : 0;
  const float fy = rows_[y] > before ? std::clamp((along - before) / (rows_[y] - before), 0.0f, 1.0f) : 0.5f;

  const float* row = &in_row_[size_t(y) * width_];
  const float across = u.x * row[width_ - 1];
  const uint32_t x = findAbove(row, width_, across);
  const float left = x > 0 ? row[x - 1] : 0;
  const float fx = row[x] > left ? std::clamp((across - left) / (row[x] - left), 0.0f, 1.0f) : 0.5f;

  const double low = rowCosine(y, height_), high = rowCosine(y + 1, height_);
  const float cosine = float(low + (high - low) * double(fy));
  const float sine = std::sqrt(std::max(0.0f, (1 - cosine) * (1 + cosine)));
  const float phi = 2 * kPi * (0.5f - (float(x) + fx) / float(width_));
  return {sine * std::sin(phi), cosine, sine * std::cos(phi)};
}

float LightImage::pdf(Vec3f direction) const {
  if (black()) return 0;
  const Vec2f st = domeImagePoint(DomeFormat::LatLong, direction);
  const uint32_t x = std::min(uint32_t(std::max(st.x, 0.0f) * float(width_)), width_ - 1);
  const uint32_t y = std::min(uint32_t(std::max(st.y, 0.0f) * float(height_)), height_ - 1);
  const float* row = &in_row_[size_t(y) * width_];
  return (row[x] - (x > 0 ? row[x - 1] : 0)) / total_;
}

}  // namespace encore
