#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "storage/map_store.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/file_lock.h"

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

namespace mapp::sqlite {

/// Owns the file's lock, the connection that writes, and the one thread that uses it. Changes that wait together share
/// one transaction, a savepoint each but the first, and so one disk sync. Thread-safe.
class WriterThread {
 public:
  WriterThread(std::unique_ptr<FileLock> lock, std::unique_ptr<Connection> db, std::function<int64_t()> unix_now_ns);
  ~WriterThread();

  /// As MapStore::Write. Not to be called from a change or an on_commit.
  Status Write(const CallContext& context, std::function<Status(MapWriter&)> change, std::function<void()> on_commit);
  /// Runs `work` between two batches, outside of a transaction.
  Status RunAlone(const CallContext& context, std::function<Status(Connection&)> work);
  /// Finishes what is queued, empties the write-ahead log into the file, closes the connection and gives up the lock.
  /// Idempotent.
  Status Stop();

 private:
  enum class State { kQueued, kBegun, kDone };
  /// Lives on the stack of the thread that waits in Write.
  struct Request {
    const CallContext& context;
    const std::function<Status(MapWriter&)> change;
    const std::function<void()> on_commit;
    const std::function<Status(Connection&)> alone;  ///< if not empty, instead of a change
    Status status;                                   ///< the writer thread's until kDone
    State state = State::kQueued;                    ///< protected by mutex_
  };

  /// Queues the request and waits for its end.
  Status Await(Request& request);
  void Run();
  Request* WaitForRequest() ABSL_LOCKS_EXCLUDED(mutex_);
  Request* TakeRequest() ABSL_LOCKS_EXCLUDED(mutex_);
  Request* PopQueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Status RunBatch(Request* first, std::vector<Request*>* batch);
  Status RunUnderSavepoint(const Request& request);
  Status RunChange(const Request& request);
  Status CheckInTransaction(const Request& request) const;
  void Conclude(const std::vector<Request*>& batch, const Status& committed);
  Status CloseDatabase();

  // Constant after construction, except that Stop ends them.
  std::unique_ptr<FileLock> lock_;
  std::unique_ptr<Connection> db_;
  const std::function<int64_t()> unix_now_ns_;

  Mutex mutex_;
  CondVar queue_changed_;
  CondVar batch_done_;
  std::deque<Request*> queue_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;

  Mutex stop_mutex_;  ///< lets one caller at a time stop the thread
  std::thread thread_;
};

}  // namespace mapp::sqlite
