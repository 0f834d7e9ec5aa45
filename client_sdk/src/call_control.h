#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/rng.h"

#include <grpcpp/client_context.h>

#include <chrono>
#include <set>

namespace mapp {

/// Lets one thread end the calls and pauses of others. Thread-safe.
class CallControl {
 public:
  /// Cancels the calls under way, ends the pauses; later ones end at once. Idempotent.
  void Cancel();
  bool cancelled() const;
  /// False when `duration` was cut short by Cancel().
  bool Pause(std::chrono::milliseconds duration);

  /// Holds a call's context for as long as the call lasts.
  class Registration {
   public:
    Registration(CallControl& control, grpc::ClientContext& context);
    ~Registration();
    Registration(const Registration&) = delete;
    Registration& operator=(const Registration&) = delete;

   private:
    CallControl& control_;
    grpc::ClientContext& context_;
  };

 private:
  mutable Mutex mutex_;
  CondVar changed_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<grpc::ClientContext*> contexts_ ABSL_GUARDED_BY(mutex_);
};

/// Pauses that double from `first` to `max`, each shortened at random by up to a half so that devices which lost the
/// same server do not come back in step. One thread only.
class Backoff {
 public:
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds max, uint64_t seed)
      : first_(first), max_(max), next_(first), rng_(seed) {}
  std::chrono::milliseconds Next();
  void Reset() { next_ = first_; }

 private:
  const std::chrono::milliseconds first_;
  const std::chrono::milliseconds max_;
  std::chrono::milliseconds next_;
  Rng rng_;
};

}  // namespace mapp
