#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/status.h"

#include <memory>
#include <set>

namespace mapp {

/// A stream that lasts until its client goes away.
class Watcher {
 public:
  virtual ~Watcher() = default;
  /// Ends the stream with `status` once what is queued for it is sent. Must not block.
  virtual void End(const Status& status) = 0;
};

/// The open streams, so that a server that stops can end them instead of waiting for their clients. Thread-safe.
class Watchers {
 public:
  /// UNAVAILABLE after EndAll(). `watcher` must stay until Remove().
  Status Add(Watcher* watcher);
  /// After this, `watcher` is not called any more.
  void Remove(Watcher* watcher);
  /// Ends the streams with UNAVAILABLE and refuses new ones.
  void EndAll();
  size_t size() const;

 private:
  mutable Mutex mutex_;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<Watcher*> watchers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
