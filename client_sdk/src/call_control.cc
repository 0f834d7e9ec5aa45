#include "call_control.h"

#include <algorithm>

namespace mapp {

void CallControl::Cancel() {
  MutexLock lock(mutex_);
  cancelled_ = true;
  for (grpc::ClientContext* context : contexts_) context->TryCancel();
  changed_.NotifyAll();
}

bool CallControl::cancelled() const {
  MutexLock lock(mutex_);
  return cancelled_;
}

bool CallControl::Pause(std::chrono::milliseconds duration) {
  const auto end = std::chrono::steady_clock::now() + duration;
  MutexLock lock(mutex_);
  while (!cancelled_) {
    if (!changed_.WaitUntil(mutex_, end) && std::chrono::steady_clock::now() >= end) return !cancelled_;
  }
  return false;
}

CallControl::Registration::Registration(CallControl& control, grpc::ClientContext& context)
    : control_(control), context_(context) {
  MutexLock lock(control_.mutex_);
  control_.contexts_.insert(&context_);
  if (control_.cancelled_) context_.TryCancel();  // a call that starts cancelled ends at once
}

CallControl::Registration::~Registration() {
  MutexLock lock(control_.mutex_);
  control_.contexts_.erase(&context_);
}

std::chrono::milliseconds Backoff::Next() {
  const double share = rng_.Uniform(0.5, 1.0);
  const auto pause = std::chrono::duration_cast<std::chrono::milliseconds>(next_ * share);
  next_ = std::min(2 * next_, max_);
  return pause;
}

}  // namespace mapp
