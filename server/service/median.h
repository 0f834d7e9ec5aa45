#pragma once

#include <algorithm>
#include <vector>

namespace mapp {

/// The upper one of two in the middle. Requires at least one value.
inline double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace mapp
