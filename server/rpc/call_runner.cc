#include "server/rpc/call_runner.h"

#include "api/status/grpc_status.h"
#include "log/log.h"

#include <fmt/format.h>

#include <exception>
#include <random>

namespace mapp {
namespace {

using std::chrono::steady_clock;
using std::chrono::system_clock;

/// Ids longer than this are cut: they come from clients and go into every log line.
constexpr size_t kMaxRequestIdLength = 64;

bool HasDeadline(const grpc::ServerContext& context) { return context.deadline() != system_clock::time_point::max(); }

steady_clock::time_point DeadlineOf(const grpc::ServerContext& context, std::chrono::milliseconds default_deadline) {
  const auto now = steady_clock::now();
  if (!HasDeadline(context)) return now + default_deadline;
  return now + (context.deadline() - system_clock::now());
}

/// Cancels a call whose client set no deadline once the server's own has passed: a reader that stalls would else hold
/// a thread, and a snapshot of the database, for ever.
class DefaultDeadline {
 public:
  DefaultDeadline(grpc::ServerContext& context, std::chrono::milliseconds deadline) {
    if (HasDeadline(context)) return;
    target_ = std::make_shared<Target>();
    {
      MutexLock lock(target_->mutex);
      target_->context = &context;
    }
    alarm_.Set(system_clock::now() + deadline, [target = target_](bool expired) {
      if (!expired) return;
      MutexLock lock(target->mutex);
      if (target->context != nullptr) target->context->TryCancel();
    });
  }
  ~DefaultDeadline() {
    if (target_ == nullptr) return;
    MutexLock lock(target_->mutex);
    target_->context = nullptr;
  }
  DefaultDeadline(const DefaultDeadline&) = delete;
  DefaultDeadline& operator=(const DefaultDeadline&) = delete;

 private:
  // Shared with the alarm's callback, which may run after the call has ended.
  struct Target {
    Mutex mutex;
    grpc::ServerContext* context ABSL_GUARDED_BY(mutex) = nullptr;
  };
  std::shared_ptr<Target> target_;
  grpc::Alarm alarm_;
};

std::string RandomPrefix() {
  std::random_device device;
  return fmt::format("{:08x}", device());
}

}  // namespace

CallRunner::CallRunner(const CallRunnerOptions& options, CallRecorder& recorder)
    : options_(options), recorder_(recorder), id_prefix_(RandomPrefix()) {}

std::string CallRunner::RequestId(const grpc::ServerContextBase& context) {
  const auto& metadata = context.client_metadata();
  if (const auto found = metadata.find(kRequestIdMetadataKey); found != metadata.end() && !found->second.empty()) {
    return {found->second.data(), std::min(found->second.size(), kMaxRequestIdLength)};
  }
  return fmt::format("{}-{}", id_prefix_, next_id_.fetch_add(1));
}

grpc::Status CallRunner::Run(const char* method, grpc::ServerContext& context, uint64_t bytes_in,
                             std::chrono::milliseconds default_deadline, const std::function<Status(Call&)>& handle) {
  const auto begin = steady_clock::now();
  const DefaultDeadline guard(context, default_deadline);
  Call call;
  call.context.deadline = DeadlineOf(context, default_deadline);
  call.context.is_cancelled = [&context] { return context.IsCancelled(); };
  call.context.request_id = RequestId(context);
  Status status;
  try {
    status = handle(call);
  } catch (const std::exception& exception) {
    log::Error("unexpected_exception",
               {{"method", method}, {"request_id", call.context.request_id}, {"what", exception.what()}});
    status = absl::InternalError(fmt::format("internal error in request {}", call.context.request_id));
  }
  AttachErrorDetail(status, context);
  Finished(method, status, call.context.request_id, context.peer(), begin, bytes_in + call.received_bytes,
           call.streamed_bytes);
  return ToGrpcStatus(status);
}

void CallRunner::Finished(const char* method, const Status& status, const std::string& request_id,
                          const std::string& peer, steady_clock::time_point begin, uint64_t bytes_in,
                          uint64_t bytes_out) {
  const auto latency = steady_clock::now() - begin;
  const std::string code = absl::StatusCodeToString(status.code());
  recorder_.Record(method, code, latency, bytes_in + bytes_out);
  const double latency_ms = std::chrono::duration<double, std::milli>(latency).count();
  if (status.ok()) {
    log::Info("rpc", {{"method", method},
                      {"code", code},
                      {"latency_ms", latency_ms},
                      {"bytes_in", bytes_in},
                      {"bytes_out", bytes_out},
                      {"request_id", request_id},
                      {"peer", peer}});
    return;
  }
  log::Info("rpc", {{"method", method},
                    {"code", code},
                    {"latency_ms", latency_ms},
                    {"bytes_in", bytes_in},
                    {"bytes_out", bytes_out},
                    {"request_id", request_id},
                    {"peer", peer},
                    {"error", std::string(status.message().data(), status.message().size())}});
}

}  // namespace mapp
