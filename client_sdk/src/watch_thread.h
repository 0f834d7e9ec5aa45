#pragma once

#include "call_control.h"
#include "mapp/client/map_client.h"
#include "mapp/v1/map_service.grpc.pb.h"

#include <functional>
#include <memory>
#include <thread>

namespace mapp {

/// Reads WatchSession in a thread of its own and reconnects until it is destroyed.
class WatchThread final : public WatchHandle {
 public:
  WatchThread(v1::MapService::StubInterface& stub, SessionId session, const Backoff& backoff,
              std::function<void(const ClientEvent&)> on_event);
  ~WatchThread() override;

 private:
  void Run();
  /// Reads one stream to its end.
  Status ReadStream();

  v1::MapService::StubInterface& stub_;
  const SessionId session_;
  Backoff backoff_;
  const std::function<void(const ClientEvent&)> on_event_;
  CallControl control_;
  std::thread thread_;  // last: uses all of the above
};

}  // namespace mapp
