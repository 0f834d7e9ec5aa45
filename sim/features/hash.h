#pragma once

#include "mapp/base/rng.h"

#include <cstdint>

namespace mapp::sim {

/// A well-mixed number of two others; the same on every platform.
inline uint64_t Hash(uint64_t a, uint64_t b) { return Rng(Rng(a).Next() ^ (b * 0xff51afd7ed558ccdULL)).Next(); }
inline uint64_t Hash(uint64_t a, uint64_t b, uint64_t c) { return Hash(Hash(a, b), c); }

}  // namespace mapp::sim
