#include "mapp/feature/feature.h"

#include <cmath>

namespace mapp {

float OctaveScale(int octave) {
  static const auto scales = [] {
    std::array<float, kPyramidLevels> values{};
    for (int i = 0; i < kPyramidLevels; ++i)
      values[static_cast<size_t>(i)] = std::pow(kPyramidScale, static_cast<float>(i));
    return values;
  }();
  return octave >= 0 && octave < kPyramidLevels ? scales[static_cast<size_t>(octave)]
                                                : std::pow(kPyramidScale, static_cast<float>(octave));
}

}  // namespace mapp
