#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <cstring>

// Four numbers at once: what Eigen 3.4 does to them one by one.

namespace mapp::sim {

using Int4 = int32_t __attribute__((vector_size(16), may_alias));
using Float4 = float __attribute__((vector_size(16), may_alias));

/// Towards zero. The values must fit.
inline Int4 Truncate(const Eigen::Array4f& values) {
  return __builtin_convertvector(*reinterpret_cast<const Float4*>(values.data()), Int4);
}

inline Eigen::Array4f ToFloat(Int4 values) {
  Eigen::Array4f result;
  *reinterpret_cast<Float4*>(result.data()) = __builtin_convertvector(values, Float4);
  return result;
}

/// Gray levels as they are stored: rounded, and limited to what a byte holds.
inline std::array<uint8_t, 4> ToLevels(const Eigen::Array4f& values) {
  const Int4 levels = Truncate((values + 0.5F).max(0.0F).min(255.0F));
  using Byte4 = uint8_t __attribute__((vector_size(4)));
  const Byte4 bytes = __builtin_convertvector(levels, Byte4);
  std::array<uint8_t, 4> result;
  std::memcpy(result.data(), &bytes, sizeof(bytes));
  return result;
}

}  // namespace mapp::sim
