// Lengths of chords along curves and grids, and where to put their vertices so that none is too long.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/dice/limit_surface.h"
#include "core/dice/tessellation.h"
#include "core/scene/math.h"

namespace encore {

// Far above every useful rate; sums of four fit uint32_t.
inline constexpr uint32_t kMaxRate = 1u << 28;

// Lengths are measured between the float positions that are output.
inline double chord(Vec3f a, Vec3f b) { return length(toDouble(b) - toDouble(a)); }
// The longest in any pose.
inline double chord(const Vec3f* a, const Vec3f* b, size_t poses) {
  double longest = chord(a[0], b[0]);
  for (size_t i = 1; i < poses; ++i) longest = std::max(longest, chord(a[i], b[i]));
  return longest;
}

// Ceiling, from 1 to kMaxRate.
uint32_t toRate(double rate);

// The longest chord of each segment of a set of lines, over all lines and poses; and the length of the longest line.
struct ChordLengths {
  std::vector<double> longest;
  double line = 0;

  double most() const;
};

// The segments that a direction needs: uniform at first, because equal segments of neighbours make regular
// grids. Where the surface runs much faster in places (at sharp corners and points of high valence, speed
// grows without bound), bisection of what is too long takes over.
class Spacing {
 public:
  // rate: where to begin. even: 0.5 stays among the parameters.
  Spacing(uint32_t rate, double allowed, bool even = false);
  // Goes on from parameters.
  Spacing(Parameters parameters, bool uniform, double allowed, bool even)
      : allowed_(allowed), even_(even), uniform_(uniform), parameters_(std::move(parameters)) {}

  const Parameters& parameters() const { return parameters_; }
  uint32_t rate() const { return uint32_t(parameters_.size()) - 1; }
  bool uniform() const { return uniform_; }
  // Given the chords of parameters(): false if all are short enough, else parameters() are new ones.
  bool refine(const ChordLengths& chords);
  // Shortens every segment in one step as far as it takes if the surface stays as it is, and no segment below
  // 1 / most_rate of the whole. false: nothing changed.
  bool stretch(ChordLengths chords, double most_rate);
  // Stays uniform, however much that takes.
  bool refineUniformly(double longest);

 private:
  void setUniform(double rate);
  // Segments that a line of the length needs if it runs evenly.
  double evenRate(const ChordLengths& chords) const { return chords.line / allowed_; }
  bool bisect(const std::vector<double>& longest);

  double allowed_;
  bool even_, uniform_ = true;
  Parameters parameters_;
};

struct GridChords {
  ChordLengths u, v;
  double across = 0;  // longest chord along u + v of a triangle's lattice
};

// The chords of a lattice on a primitive, sides included. Triangle: v as u, of uniform parameters.
GridChords gridChords(const LimitSurface& surface, int32_t corner, DomainShape shape, const Parameters& u,
                      const Parameters& v);

// The chords of a curve: curve(t, out) gives the positions of all poses. points: those at the parameters.
template <class Curve>
ChordLengths curveChords(const Curve& curve, const Parameters& parameters, size_t poses, std::vector<Vec3f>& points) {
  ChordLengths chords;
  points.resize(parameters.size() * poses);
  for (size_t i = 0; i < parameters.size(); ++i) {
    Vec3f* p = &points[i * poses];
    curve(parameters[i], p);
    if (i == 0) continue;
    chords.longest.push_back(chord(p - poses, p, poses));
    chords.line += chords.longest.back();
  }
  return chords;
}

}  // namespace encore
