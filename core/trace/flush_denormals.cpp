#include <xmmintrin.h>

#include "core/trace/trace_scene.h"

namespace encore {

namespace {
// MXCSR: denormals-are-zero and flush-to-zero (Intel SDM vol. 1, 10.2.3).
constexpr uint32_t kFlushBits = 1u << 6 | 1u << 15;
}  // namespace

FlushDenormals::FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | kFlushBits); }
FlushDenormals::~FlushDenormals() { _mm_setcsr((_mm_getcsr() & ~kFlushBits) | (saved_ & kFlushBits)); }

}  // namespace encore
