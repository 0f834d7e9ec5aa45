#pragma once

#include "mapp/base/status.h"

#include <memory>
#include <stop_token>

namespace mapp {

/// Turns SIGINT and SIGTERM into a stop request for as long as it lives; a second signal ends the process at once.
/// One at a time.
class InterruptWatcher {
 public:
  static StatusOr<std::unique_ptr<InterruptWatcher>> Create();
  ~InterruptWatcher();
  std::stop_token token() const;

 private:
  struct Impl;
  explicit InterruptWatcher(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
