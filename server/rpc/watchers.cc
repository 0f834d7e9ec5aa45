#include "server/rpc/watchers.h"

namespace mapp {
namespace {

Status ShuttingDown() { return absl::UnavailableError("the server is shutting down"); }

}  // namespace

Status Watchers::Add(Watcher* watcher) {
  MutexLock lock(mutex_);
  if (closed_) return ShuttingDown();
  watchers_.insert(watcher);
  return absl::OkStatus();
}

void Watchers::Remove(Watcher* watcher) {
  MutexLock lock(mutex_);
  watchers_.erase(watcher);
}

void Watchers::EndAll() {
  MutexLock lock(mutex_);
  closed_ = true;
  for (Watcher* watcher : watchers_) watcher->End(ShuttingDown());
}

size_t Watchers::size() const {
  MutexLock lock(mutex_);
  return watchers_.size();
}

}  // namespace mapp
