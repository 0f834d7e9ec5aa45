#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/status.h"

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>

namespace mapp::memory {

/// Lets one thread through at a time, in the order they came. Thread-safe.
class Turnstile {
 public:
  /// Whose turn it is, until it is destroyed.
  class Turn {
   public:
    Turn(Turn&&) = default;
    Turn& operator=(Turn&&) = delete;

   private:
    friend class Turnstile;
    struct Leave {
      void operator()(Turnstile* turnstile) const { turnstile->LetNextIn(); }
    };
    explicit Turn(Turnstile* turnstile) : turnstile_(turnstile) {}

    std::unique_ptr<Turnstile, Leave> turnstile_;
  };

  /// Waits for the caller's turn. DEADLINE_EXCEEDED when it has not come until then; UNAVAILABLE once closed.
  StatusOr<Turn> Enter(std::chrono::steady_clock::time_point deadline);
  /// Lets nobody in any more, and waits for those who came before. True for the one call that has closed it.
  bool Close();
  bool is_closed() const;

 private:
  void LetNextIn();

  mutable Mutex mutex_;
  CondVar queue_changed_;
  /// Tickets; the first one has its turn.
  std::deque<uint64_t> queue_ ABSL_GUARDED_BY(mutex_);
  uint64_t next_ticket_ ABSL_GUARDED_BY(mutex_) = 0;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace mapp::memory
