#pragma once

#include "mapp/base/status.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <string_view>
#include <utility>

namespace mapp {

/// Ends the program with the error, after the program's name and `what` was tried.
inline void OkOrExit(const Status& status, std::string_view what = "error") {
  if (status.ok()) return;
  fmt::print(stderr, "{}: {}: {}\n", program_invocation_short_name, what, status.ToString());
  std::exit(1);
}

template <typename T>
T ValueOrExit(StatusOr<T> value, std::string_view what = "error") {
  OkOrExit(value.status(), what);
  return *std::move(value);
}

}  // namespace mapp
