#include "mapp/base/status.h"

#include "mapp/base/call_context.h"

namespace mapp {

Status Annotate(const Status& status, const std::string& context) {
  if (status.ok()) return status;
  Status annotated(status.code(), context + ": " + std::string(status.message()));
  status.ForEachPayload(
      [&annotated](const auto& type_url, const absl::Cord& payload) { annotated.SetPayload(type_url, payload); });
  return annotated;
}

Status CallContext::Check() const {
  if (is_cancelled && is_cancelled()) return absl::CancelledError("the caller gave up");
  if (std::chrono::steady_clock::now() > deadline) return absl::DeadlineExceededError("the call's deadline passed");
  return absl::OkStatus();
}

}  // namespace mapp
