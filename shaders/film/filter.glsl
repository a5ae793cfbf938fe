// Reconstruction filters, separable. The twin of core/film/filter.cpp, bit for bit: only additions,
// multiplications and comparisons in one order, and `precise` forbids to fuse them.

layout(constant_id = 0) const uint kFilter = 0;            // FilterKind: box, Gaussian, Mitchell, Blackman-Harris
layout(constant_id = 1) const float kRadius = 0.5;         // pixels
layout(constant_id = 2) const float kInverseRadius = 2.0;  // 1 / kRadius, as the host rounds it
layout(constant_id = 3) const uint kPad = 0;               // filterPad(kRadius)

const uint kFilterBox = 0;
const uint kFilterGaussian = 1;
const uint kFilterMitchell = 2;
const uint kFilterBlackmanHarris = 3;

// exp(-4.5 t²) - exp(-4.5), t in [0, 1]: three standard deviations, lowered to reach 0 at the radius.
float gaussianWeight(float t) {
  precise float y = 0.28125 * (t * t);  // 4.5 t² / 16: a short series, then the 16th power
  precise float e = 1.0 - y * 0.16666667;
  e = 1.0 - y * 0.2 * e;
  e = 1.0 - y * 0.25 * e;
  e = 1.0 - y * 0.33333334 * e;
  e = 1.0 - y * 0.5 * e;
  e = 1.0 - y * e;
  e = e * e;
  e = e * e;
  e = e * e;
  e = e * e;
  precise float weight = max(e - 0.011108996, 0.0);
  return weight;
}

// Mitchell & Netravali 1988 with B = C = 1/3, over [0, 2].
float mitchellWeight(float t) {
  precise float s = 2.0 * t;
  precise float inner = (1.1666666 * s - 2.0) * s * s + 0.8888889;
  precise float outer = ((-0.3888889 * s + 2.0) * s - 3.3333333) * s + 1.7777778;
  return s < 1.0 ? inner : outer;
}

// The four-term window of Harris 1978 as a polynomial of cos(πt), which is a polynomial of t² fitted over
// Chebyshev nodes. Right to 1.1e-6.
float blackmanHarrisWeight(float t) {
  precise float q = t * t;
  precise float c = 0.22965036 - q * 0.020577252;
  c = q * c - 1.3323691;
  c = q * c + 4.058041;
  c = q * c - 4.9347453;
  c = q * c + 0.9999992;
  precise float weight = 0.21747 + c * (0.45325 + c * (0.28256 + c * 0.04672));
  return weight;
}

// x: pixel centre minus sample position, along one axis. See filterWeight() in core/film/film.h.
// No branches but on constants: an early return costs more than the arithmetic that it saves.
float filterWeight(float x) {
  if (kFilter == kFilterBox) return x > -kRadius && x <= kRadius ? 1.0 : 0.0;
  precise float t = abs(x) * kInverseRadius;
  float weight;
  if (kFilter == kFilterGaussian) {
    weight = gaussianWeight(t);
  } else if (kFilter == kFilterMitchell) {
    weight = mitchellWeight(t);
  } else {
    weight = blackmanHarrisWeight(t);
  }
  return abs(x) < kRadius ? weight : 0.0;
}
