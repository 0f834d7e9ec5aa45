#pragma once

#include "mapp/base/status.h"
#include "mapp/v1/types.pb.h"

#include <grpcpp/client_context.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/status.h>

#include <optional>
#include <string>

/// absl <-> gRPC: both number their codes alike, which the .cc asserts. Messages travel as they are; the offending
/// field and a stable reason travel beside them, as a v1::ErrorDetail in trailing metadata.
namespace mapp {

/// Trailing metadata of failed calls: a serialised v1::ErrorDetail.
inline constexpr char kErrorMetadataKey[] = "mapp-error-bin";
/// Request metadata: the caller's own id for the call, shown in the server's access log.
inline constexpr char kRequestIdMetadataKey[] = "mapp-request-id";

grpc::Status ToGrpcStatus(const Status& status);
Status FromGrpcStatus(const grpc::Status& status);

/// "camera.fx" of "camera.fx: must be positive, got 0". Empty for other codes than INVALID_ARGUMENT and
/// FAILED_PRECONDITION, and when the message does not begin with a field's path.
std::string FieldPath(const Status& status);

/// Puts the ErrorDetail of `status` into the call's trailing metadata; nothing for OK.
void AttachErrorDetail(const Status& status, grpc::ServerContextBase& context);
/// The ErrorDetail that a finished call came back with, if any.
std::optional<v1::ErrorDetail> ErrorDetailOf(const grpc::ClientContext& context);

}  // namespace mapp
