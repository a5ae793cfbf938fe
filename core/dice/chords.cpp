#include "core/dice/chords.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace encore {
namespace {

// Uniform segments may be this many times what an even run would take (and two more) before bisection.
constexpr double kUniformWaste = 2;
// Segments this short in parameter are noise.
constexpr double kLeastSegment = 0x1p-40;

}  // namespace

uint32_t toRate(double rate) { return rate < kMaxRate ? std::max(1u, uint32_t(std::ceil(rate))) : kMaxRate; }

double ChordLengths::most() const { return longest.empty() ? 0 : *std::max_element(longest.begin(), longest.end()); }

Spacing::Spacing(uint32_t rate, double allowed, bool even) : allowed_(allowed), even_(even) { setUniform(rate); }

void Spacing::setUniform(double rate) {
  const uint32_t n = toRate(rate);
  parameters_ = uniformParameters(even_ ? n + n % 2 : n);
}

bool Spacing::refine(const ChordLengths& chords) {
  if (!uniform_) return bisect(chords.longest);
  const double longest = chords.most();
  const double needed = longest > allowed_ ? std::max(rate() + 1.0, rate() * (longest / allowed_)) : rate();
  if (needed <= kUniformWaste * std::ceil(evenRate(chords)) + 2) return refineUniformly(longest);
  uniform_ = false;
  setUniform(std::max(2.0, evenRate(chords)));
  return true;
}

bool Spacing::stretch(ChordLengths chords, double most_rate) {
  for (size_t i = 0; i < chords.longest.size(); ++i) {
    const double parts = std::max(1.0, std::floor((parameters_[i + 1] - parameters_[i]) * most_rate + 1e-6));
    chords.longest[i] = std::min(chords.longest[i], allowed_ * parts);
  }
  const double longest = chords.most();
  if (!(longest > allowed_)) return false;
  if (uniform_ && rate() * (longest / allowed_) <= kUniformWaste * std::ceil(evenRate(chords)) + 2)
    return refineUniformly(longest);
  uniform_ = false;
  Parameters refined;
  for (size_t i = 0; i + 1 < parameters_.size(); ++i) {
    const uint32_t parts = toRate(chords.longest[i] / allowed_);
    for (uint32_t k = 0; k < parts; ++k)
      refined.push_back(parameters_[i] + (parameters_[i + 1] - parameters_[i]) * k / parts);
  }
  refined.push_back(1);
  parameters_ = std::move(refined);
  return true;
}

bool Spacing::refineUniformly(double longest) {
  if (!(longest > allowed_) || rate() >= kMaxRate) return false;
  setUniform(std::max(rate() + 1.0, rate() * (longest / allowed_)));
  return true;
}

bool Spacing::bisect(const std::vector<double>& longest) {
  Parameters refined;
  for (size_t i = 0; i + 1 < parameters_.size(); ++i) {
    refined.push_back(parameters_[i]);
    if (longest[i] > allowed_ && parameters_[i + 1] - parameters_[i] > kLeastSegment)
      refined.push_back((parameters_[i] + parameters_[i + 1]) / 2);
  }
  refined.push_back(1);
  std::swap(refined, parameters_);
  return refined.size() != parameters_.size();
}

GridChords gridChords(const LimitSurface& surface, int32_t corner, DomainShape shape, const Parameters& u,
                      const Parameters& v) {
  const bool quad = shape == DomainShape::Quad;
  GridChords chords;
  chords.u.longest.assign(u.size() - 1, 0);
  chords.v.longest.assign(v.size() - 1, 0);
  std::vector<double> column(u.size(), 0);  // lengths so far
  const size_t poses = surface.poses();
  std::vector<Vec3f> row(u.size() * poses), below(u.size() * poses);
  for (size_t j = 0; j < v.size(); ++j) {
    double line = 0;
    for (size_t i = 0; i < (quad ? u.size() : u.size() - j); ++i) {
      Vec3f* p = &row[i * poses];
      surface.positions(corner, {u[i], v[j]}, p);
      if (i > 0) {
        const double along = chord(p - poses, p, poses);
        chords.u.longest[i - 1] = std::max(chords.u.longest[i - 1], along);
        line += along;
      }
      if (j > 0) {
        const double along = chord(&below[i * poses], p, poses);
        chords.v.longest[j - 1] = std::max(chords.v.longest[j - 1], along);
        column[i] += along;
        if (!quad) chords.across = std::max(chords.across, chord(&below[(i + 1) * poses], p, poses));
      }
    }
    chords.u.line = std::max(chords.u.line, line);
    std::swap(row, below);
  }
  chords.v.line = *std::max_element(column.begin(), column.end());
  return chords;
}

}  // namespace encore
