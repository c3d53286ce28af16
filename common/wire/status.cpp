#include "common/wire/status.h"

#include <string>
#include <string_view>

namespace palpate {
namespace {

grpc::StatusCode CodeOf(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kInternal:
      return grpc::StatusCode::INTERNAL;
    case ErrorKind::kInvalidArgument:
      return grpc::StatusCode::INVALID_ARGUMENT;
    case ErrorKind::kNotFound:
      return grpc::StatusCode::NOT_FOUND;
    case ErrorKind::kPermissionDenied:
      return grpc::StatusCode::PERMISSION_DENIED;
    case ErrorKind::kTooLarge:
    case ErrorKind::kDiskFull:
      return grpc::StatusCode::RESOURCE_EXHAUSTED;
    case ErrorKind::kConflict:
      return grpc::StatusCode::ABORTED;
    case ErrorKind::kUnavailable:
      return grpc::StatusCode::UNAVAILABLE;
    case ErrorKind::kCancelled:
      return grpc::StatusCode::CANCELLED;
    case ErrorKind::kFailedPrecondition:
      return grpc::StatusCode::FAILED_PRECONDITION;
  }
  return grpc::StatusCode::INTERNAL;
}

// The serialised google.rpc.Status {code: 8, details: [google.rpc.ErrorInfo {reason: "DISK_FULL",
// domain: "palpate"}]}: the form in which gRPC's tools expect details.
constexpr std::string_view kDiskFullDetails =
    "\x08\x08\x1a\x40\x0a\x28type.googleapis.com/google.rpc.ErrorInfo"
    "\x12\x14\x0a\x09"
    "DISK_FULL\x12\x07palpate";
constexpr std::string_view kDiskFullReason = "DISK_FULL";

ErrorKind KindOf(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::OUT_OF_RANGE:
      return ErrorKind::kInvalidArgument;
    case grpc::StatusCode::NOT_FOUND:
      return ErrorKind::kNotFound;
    case grpc::StatusCode::PERMISSION_DENIED:
    case grpc::StatusCode::UNAUTHENTICATED:
      return ErrorKind::kPermissionDenied;
    case grpc::StatusCode::RESOURCE_EXHAUSTED:
      return ErrorKind::kTooLarge;
    case grpc::StatusCode::ABORTED:
    case grpc::StatusCode::ALREADY_EXISTS:
      return ErrorKind::kConflict;
    case grpc::StatusCode::FAILED_PRECONDITION:
      return ErrorKind::kFailedPrecondition;
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
    case grpc::StatusCode::UNIMPLEMENTED:
      return ErrorKind::kUnavailable;
    case grpc::StatusCode::CANCELLED:
      return ErrorKind::kCancelled;
    default:
      return ErrorKind::kInternal;
  }
}

}  // namespace

grpc::Status ToStatus(const std::exception& exception) {
  const auto* error = dynamic_cast<const Error*>(&exception);
  if (!error) return {grpc::StatusCode::INTERNAL, exception.what()};
  const bool disk_full = error->kind() == ErrorKind::kDiskFull;
  return {CodeOf(error->kind()), exception.what(), std::string(disk_full ? kDiskFullDetails : "")};
}

Error FromStatus(const grpc::Status& status) {
  const bool disk_full = status.error_details().find(kDiskFullReason) != std::string::npos;
  return {disk_full ? ErrorKind::kDiskFull : KindOf(status.error_code()), status.error_message()};
}

}  // namespace palpate
