// Functions in two versions: for any processor, and for those with AVX2, chosen when the program is loaded.
// Both round alike, operation by operation (contraction is off), so that results do not depend on the choice.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define ENCORE_AVX2_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ENCORE_AVX2_CLONES
#endif
