#include "storage/memory/turnstile.h"

#include "storage/checks.h"

#include <utility>

namespace mapp::memory {

StatusOr<Turnstile::Turn> Turnstile::Enter(std::chrono::steady_clock::time_point deadline) {
  const MutexLock lock(mutex_);
  if (closed_) return internal::StoreIsClosed();
  const uint64_t ticket = next_ticket_++;
  queue_.push_back(ticket);
  while (queue_.front() != ticket) {
    if (deadline == std::chrono::steady_clock::time_point::max()) {
      queue_changed_.Wait(mutex_);
    } else if (!queue_changed_.WaitUntil(mutex_, deadline) && queue_.front() != ticket) {
      std::erase(queue_, ticket);
      return internal::WaitedPastDeadline();
    }
  }
  return Turn(this);
}

bool Turnstile::Close() {
  const MutexLock lock(mutex_);
  const bool was_open = !std::exchange(closed_, true);
  while (!queue_.empty()) queue_changed_.Wait(mutex_);
  return was_open;
}

bool Turnstile::is_closed() const {
  const MutexLock lock(mutex_);
  return closed_;
}

void Turnstile::LetNextIn() {
  const MutexLock lock(mutex_);
  queue_.pop_front();
  queue_changed_.NotifyAll();
}

}  // namespace mapp::memory
