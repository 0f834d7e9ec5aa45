#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <cstring>

// Four numbers at once: what Eigen 3.4 does to them one by one.

namespace mapp::sim {

using Int4 = int32_t __attribute__((vector_size(16), may_alias));
using Float4 = float __attribute__((vector_size(16), may_alias));

inline Float4 ToFour(const Eigen::Array4f& values) { return *reinterpret_cast<const Float4*>(values.data()); }

inline Eigen::Array4f ToArray(Float4 values) {
  Eigen::Array4f result;
  *reinterpret_cast<Float4*>(result.data()) = values;
  return result;
}

/// Towards zero. The values must fit.
inline Int4 Truncate(const Eigen::Array4f& values) { return __builtin_convertvector(ToFour(values), Int4); }

inline Eigen::Array4f ToFloat(Int4 values) { return ToArray(__builtin_convertvector(values, Float4)); }

/// For each of the four, whether they are equal: all bits set, or none.
inline Int4 AreEqual(const Eigen::Array4f& values, float to) { return reinterpret_cast<Int4>(ToFour(values) == to); }
inline Int4 AreGreater(const Eigen::Array4f& values, const Eigen::Array4f& than) {
  return reinterpret_cast<Int4>(ToFour(values) > ToFour(than));
}
inline bool IsAnySet(Int4 mask) { return (mask[0] | mask[1] | mask[2] | mask[3]) != 0; }

/// `values` where the mask is set, elsewhere `others`.
inline Eigen::Array4f Select(Int4 mask, const Eigen::Array4f& values, const Eigen::Array4f& others) {
  return ToArray(reinterpret_cast<Float4>((mask & reinterpret_cast<Int4>(ToFour(values))) |
                                          (~mask & reinterpret_cast<Int4>(ToFour(others)))));
}
/// `values` where the mask is set, elsewhere 0.
inline Eigen::Array4f Masked(Int4 mask, const Eigen::Array4f& values) {
  return ToArray(reinterpret_cast<Float4>(mask & reinterpret_cast<Int4>(ToFour(values))));
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
