#include "server/service/session_events.h"

#include <utility>

namespace mapp {

SessionEvents::Subscription::~Subscription() {
  // Callbacks run under the lock, so once it is taken none is running.
  MutexLock lock(events_->mutex_);
  events_->listeners_.erase(id_);
}

std::unique_ptr<SessionEvents::Subscription> SessionEvents::Subscribe(SessionId session, MapId map, Callback callback) {
  auto subscription = std::make_unique<Subscription>();
  MutexLock lock(mutex_);
  subscription->events_ = this;
  subscription->id_ = next_id_++;
  listeners_.emplace(subscription->id_, Listener{session, map, std::move(callback)});
  return subscription;
}

void SessionEvents::Publish(SessionId session, const SessionEvent& event) {
  MutexLock lock(mutex_);
  for (const auto& [id, listener] : listeners_) {
    if (listener.session == session) listener.callback(event);
  }
}

void SessionEvents::PublishToMap(MapId map, const SessionEvent& event) {
  MutexLock lock(mutex_);
  for (const auto& [id, listener] : listeners_) {
    if (listener.map == map) listener.callback(event);
  }
}

}  // namespace mapp
