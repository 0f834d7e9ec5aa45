#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "server/rpc/call_recorder.h"

#include <grpcpp/alarm.h>
#include <grpcpp/server_context.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>

namespace mapp {

/// What a handler knows of the call it serves.
struct Call {
  CallContext context;
  /// Serialised size of the messages streamed back; unary answers are counted by the runner.
  uint64_t streamed_bytes = 0;
  /// The same of those that a client streams.
  uint64_t received_bytes = 0;
};

struct CallRunnerOptions {
  /// For calls whose client set no deadline.
  std::chrono::milliseconds default_unary_deadline{30'000};
  std::chrono::milliseconds default_stream_deadline{600'000};
};

/// What all calls have in common: deadline, cancellation, request id, error detail, access log, latency figures.
/// Thread-safe.
class CallRunner {
 public:
  CallRunner(const CallRunnerOptions& options, CallRecorder& recorder);

  /// Runs `handle` and turns its status into the call's. An exception becomes INTERNAL; its text goes to the log only.
  template <typename Request, typename Response>
  grpc::Status Unary(const char* method, grpc::ServerContext& context, const Request& request, Response& response,
                     const std::function<Status(const Call&)>& handle) {
    return Run(method, context, request.ByteSizeLong(), options_.default_unary_deadline, [&](Call& call) {
      Status status = handle(call);
      if (status.ok()) call.streamed_bytes = response.ByteSizeLong();
      return status;
    });
  }

  /// As Unary, for a call that streams; `handle` adds what it sends to Call::streamed_bytes.
  template <typename Request>
  grpc::Status Stream(const char* method, grpc::ServerContext& context, const Request& request,
                      const std::function<Status(Call&)>& handle) {
    return Run(method, context, request.ByteSizeLong(), options_.default_stream_deadline, handle);
  }

  /// As Stream, for a call in which the client streams, too; `handle` adds what it receives to Call::received_bytes.
  grpc::Status StreamBoth(const char* method, grpc::ServerContext& context,
                          const std::function<Status(Call&)>& handle) {
    return Run(method, context, 0, options_.default_stream_deadline, handle);
  }

  /// The caller's request id, or a new one.
  std::string RequestId(const grpc::ServerContextBase& context);
  /// Access log and figures of a finished call.
  void Finished(const char* method, const Status& status, const std::string& request_id, const std::string& peer,
                std::chrono::steady_clock::time_point begin, uint64_t bytes_in, uint64_t bytes_out);
  const CallRecorder& recorder() const { return recorder_; }

 private:
  grpc::Status Run(const char* method, grpc::ServerContext& context, uint64_t bytes_in,
                   std::chrono::milliseconds default_deadline, const std::function<Status(Call&)>& handle);

  const CallRunnerOptions options_;
  CallRecorder& recorder_;
  const std::string id_prefix_;  // differs between runs of the server
  std::atomic<uint64_t> next_id_{1};
};

}  // namespace mapp
