#pragma once

#include <chrono>
#include <cstdint>

namespace mapp {

/// Nanoseconds since 1970, by the system's clock.
inline int64_t UnixNowNs() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

}  // namespace mapp
