#include "mapp/base/unix_time.h"

#include <fmt/chrono.h>

#include <ctime>

namespace mapp {

std::string FormatUtc(int64_t unix_ns) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(static_cast<std::time_t>(unix_ns / 1'000'000'000)));
}

}  // namespace mapp
