#pragma once

#include "eval/harness/figures.h"
#include "eval/harness/lab.h"
#include "eval/process/child_process.h"
#include "mapp/base/status.h"

#include <chrono>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

/// Waits for a child, in slices so that a stop request is heard. ABORTED naming `what`, its exit code and its log
/// when it does not end with 0, DEADLINE_EXCEEDED when it does not end; CANCELLED on a stop request. A child that has
/// not ended is told to (SIGTERM).
Status WaitFor(ChildProcess& child, const std::string& what, const std::string& log, std::chrono::milliseconds timeout,
               const std::stop_token& stop);

/// A `mapp-server` of its own on a loopback port, with its database `folder`/map.db. Killed with this object.
class EvalServer {
 public:
  static StatusOr<std::unique_ptr<EvalServer>> Start(const Programs& programs, const std::string& folder,
                                                     const std::stop_token& stop);
  const std::string& address() const { return address_; }
  const std::string& database() const { return database_; }
  StatusOr<ProcessUsage> Usage() const { return process_->Usage(); }
  /// Ends it in an orderly way.
  Status Stop(const std::stop_token& stop);

 private:
  EvalServer() = default;
  std::unique_ptr<ChildProcess> process_;
  std::string address_;
  std::string database_;
  std::string log_;
};

}  // namespace mapp
