#include "api/status/grpc_status.h"

#include <algorithm>
#include <cctype>

namespace mapp {
namespace {

constexpr bool SameNumber(absl::StatusCode ours, grpc::StatusCode theirs) {
  return static_cast<int>(ours) == static_cast<int>(theirs);
}
static_assert(SameNumber(absl::StatusCode::kOk, grpc::StatusCode::OK));
static_assert(SameNumber(absl::StatusCode::kCancelled, grpc::StatusCode::CANCELLED));
static_assert(SameNumber(absl::StatusCode::kUnknown, grpc::StatusCode::UNKNOWN));
static_assert(SameNumber(absl::StatusCode::kInvalidArgument, grpc::StatusCode::INVALID_ARGUMENT));
static_assert(SameNumber(absl::StatusCode::kDeadlineExceeded, grpc::StatusCode::DEADLINE_EXCEEDED));
static_assert(SameNumber(absl::StatusCode::kNotFound, grpc::StatusCode::NOT_FOUND));
static_assert(SameNumber(absl::StatusCode::kAlreadyExists, grpc::StatusCode::ALREADY_EXISTS));
static_assert(SameNumber(absl::StatusCode::kPermissionDenied, grpc::StatusCode::PERMISSION_DENIED));
static_assert(SameNumber(absl::StatusCode::kResourceExhausted, grpc::StatusCode::RESOURCE_EXHAUSTED));
static_assert(SameNumber(absl::StatusCode::kFailedPrecondition, grpc::StatusCode::FAILED_PRECONDITION));
static_assert(SameNumber(absl::StatusCode::kAborted, grpc::StatusCode::ABORTED));
static_assert(SameNumber(absl::StatusCode::kOutOfRange, grpc::StatusCode::OUT_OF_RANGE));
static_assert(SameNumber(absl::StatusCode::kUnimplemented, grpc::StatusCode::UNIMPLEMENTED));
static_assert(SameNumber(absl::StatusCode::kInternal, grpc::StatusCode::INTERNAL));
static_assert(SameNumber(absl::StatusCode::kUnavailable, grpc::StatusCode::UNAVAILABLE));
static_assert(SameNumber(absl::StatusCode::kDataLoss, grpc::StatusCode::DATA_LOSS));
static_assert(SameNumber(absl::StatusCode::kUnauthenticated, grpc::StatusCode::UNAUTHENTICATED));

std::string Message(const Status& status) { return {status.message().data(), status.message().size()}; }

bool IsPathCharacter(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.' || c == '[' || c == ']';
}

}  // namespace

grpc::Status ToGrpcStatus(const Status& status) {
  if (status.ok()) return grpc::Status::OK;
  return {static_cast<grpc::StatusCode>(status.code()), Message(status)};
}

Status FromGrpcStatus(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  return {static_cast<absl::StatusCode>(status.error_code()), status.error_message()};
}

std::string FieldPath(const Status& status) {
  if (!absl::IsInvalidArgument(status) && !absl::IsFailedPrecondition(status)) return "";
  const std::string message = Message(status);
  const size_t colon = message.find(": ");
  if (colon == std::string::npos) return "";
  const std::string path = message.substr(0, colon);
  return std::all_of(path.begin(), path.end(), IsPathCharacter) ? path : "";
}

void AttachErrorDetail(const Status& status, grpc::ServerContextBase& context) {
  if (status.ok()) return;
  v1::ErrorDetail detail;
  detail.set_field(FieldPath(status));
  detail.set_reason(absl::StatusCodeToString(status.code()));
  context.AddTrailingMetadata(kErrorMetadataKey, detail.SerializeAsString());
}

std::optional<v1::ErrorDetail> ErrorDetailOf(const grpc::ClientContext& context) {
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find(kErrorMetadataKey);
  if (found == trailing.end()) return std::nullopt;
  v1::ErrorDetail detail;
  if (!detail.ParseFromArray(found->second.data(), static_cast<int>(found->second.size()))) return std::nullopt;
  return detail;
}

}  // namespace mapp
