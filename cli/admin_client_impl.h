#pragma once

#include "api/status/grpc_status.h"
#include "cli/admin_client.h"
#include "mapp/v1/admin_service.grpc.pb.h"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <string>

namespace mapp {

inline constexpr std::chrono::seconds kCallTimeout(10);
/// Deleting and exporting touch everything a map holds.
inline constexpr std::chrono::minutes kBulkCallTimeout(10);
/// Any database is copied and checked by then.
inline constexpr std::chrono::hours kWholeFileTimeout(24);

/// A server's own answer that fails validation is not the caller's fault.
inline Status BadAnswer(const Status& status) {
  return absl::DataLossError(fmt::format("the server's answer: {}", std::string(status.message())));
}

struct AdminClient::Impl {
  std::string server;
  std::unique_ptr<v1::AdminService::Stub> stub;

  Status ToStatus(const grpc::Status& status) const {
    if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
      return Annotate(FromGrpcStatus(status), fmt::format("server {}", server));
    }
    return FromGrpcStatus(status);
  }

  template <typename Request, typename Response>
  StatusOr<Response> Call(grpc::Status (v1::AdminService::Stub::*method)(grpc::ClientContext*, const Request&,
                                                                         Response*),
                          const Request& request, std::chrono::milliseconds timeout) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout);
    Response response;
    MAPP_RETURN_IF_ERROR(ToStatus((stub.get()->*method)(&context, request, &response)));
    return response;
  }

  static StatusOr<MapSummary> ToMapSummary(const v1::MapInfo& info);
};

}  // namespace mapp
