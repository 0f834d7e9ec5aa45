#pragma once

#include "mapp/base/status.h"

#include <chrono>
#include <functional>
#include <stop_token>
#include <string>

namespace mapp {

/// What travels with every call that may block: until when, whether the caller is still there, and its id in the logs.
struct CallContext {
  std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max();
  /// Asked now and then by long work; empty means "never cancelled".
  std::function<bool()> is_cancelled;
  std::string request_id;

  static CallContext WithTimeout(std::chrono::milliseconds timeout) {
    return {.deadline = std::chrono::steady_clock::now() + timeout, .is_cancelled = {}, .request_id = {}};
  }
  /// DEADLINE_EXCEEDED or CANCELLED when the work should stop.
  Status Check() const;
};

}  // namespace mapp
