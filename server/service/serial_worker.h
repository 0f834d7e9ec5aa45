#pragma once

#include "mapp/base/mutex.h"

#include <deque>
#include <functional>
#include <thread>
#include <utility>

namespace mapp {

/// Runs tasks one after the other on a thread of its own. The queue is bounded and refuses what does not fit, so that
/// whoever pushes never waits. Thread-safe.
template <typename Task>
class SerialWorker {
 public:
  SerialWorker(size_t capacity, std::function<void(const Task&)> run)
      : capacity_(capacity), run_(std::move(run)), thread_([this] { Loop(); }) {}
  ~SerialWorker() { Stop(); }
  SerialWorker(const SerialWorker&) = delete;
  SerialWorker& operator=(const SerialWorker&) = delete;

  /// False when the queue is full or the worker stopped.
  bool Push(Task task) {
    {
      const MutexLock lock(mutex_);
      if (stopping_ || tasks_.size() >= capacity_) return false;
      tasks_.push_back(std::move(task));
    }
    changed_.NotifyOne();
    return true;
  }

  /// Waits until there is nothing to do, or the worker has been stopped. Not to be called from a task.
  void WaitUntilIdle() {
    const MutexLock lock(mutex_);
    while (!stopping_ && (busy_ || !tasks_.empty())) idle_.Wait(mutex_);
  }

  /// Waits for the task in hand, drops the others. Idempotent; not to be called from a task.
  void Stop() {
    {
      const MutexLock lock(mutex_);
      stopping_ = true;
      tasks_.clear();
    }
    changed_.NotifyAll();
    idle_.NotifyAll();
    const MutexLock lock(join_mutex_);
    if (thread_.joinable()) thread_.join();
  }

 private:
  void Loop() {
    for (;;) {
      Task task;
      {
        const MutexLock lock(mutex_);
        busy_ = false;
        if (tasks_.empty()) idle_.NotifyAll();
        while (tasks_.empty() && !stopping_) changed_.Wait(mutex_);
        if (stopping_) return;
        task = std::move(tasks_.front());
        tasks_.pop_front();
        busy_ = true;
      }
      run_(task);
    }
  }

  const size_t capacity_;
  const std::function<void(const Task&)> run_;
  Mutex mutex_;
  CondVar changed_;
  CondVar idle_;
  std::deque<Task> tasks_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool busy_ ABSL_GUARDED_BY(mutex_) = false;
  Mutex join_mutex_;  ///< lets two threads stop it at once
  std::jthread thread_;
};

}  // namespace mapp
