#pragma once

#include "cli/canvas.h"

namespace mapp {

/// The color of what is about a thing that vanished, appeared, has moved from here or to here, in pictures and PLY.
inline constexpr Color kVanishedColor{200, 30, 30};
inline constexpr Color kAppearedColor{20, 140, 40};
inline constexpr Color kMovedFromColor{220, 130, 0};
inline constexpr Color kMovedToColor{0, 114, 178};

}  // namespace mapp
