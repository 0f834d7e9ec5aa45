#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace mapp {

/// Nanoseconds since 1970, by the system's clock.
inline int64_t UnixNowNs() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

/// As people read it, to the second: 2026-11-23T15:04:05Z.
std::string FormatUtc(int64_t unix_ns);

}  // namespace mapp
