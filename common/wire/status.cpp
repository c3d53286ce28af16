#include "common/wire/status.h"

#include <new>
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
    case ErrorKind::kLoading:
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
// The same with {code: 14, reason: "LOADING"}.
constexpr std::string_view kLoadingDetails =
    "\x08\x0e\x1a\x3e\x0a\x28type.googleapis.com/google.rpc.ErrorInfo"
    "\x12\x12\x0a\x07"
    "LOADING\x12\x07palpate";
constexpr std::string_view kLoadingReason = "LOADING";

std::string_view DetailsOf(ErrorKind kind) {
  if (kind == ErrorKind::kDiskFull) return kDiskFullDetails;
  return kind == ErrorKind::kLoading ? kLoadingDetails : "";
}

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
  if (dynamic_cast<const std::bad_alloc*>(&exception)) {
    return {CodeOf(ErrorKind::kTooLarge), "palpated has no memory left for this"};
  }
  if (!error) return {grpc::StatusCode::INTERNAL, exception.what()};
  return {CodeOf(error->kind()), exception.what(), std::string(DetailsOf(error->kind()))};
}

Error FromStatus(const grpc::Status& status) {
  const auto says = [&](std::string_view reason) {
    return status.error_details().find(reason) != std::string::npos;
  };
  const ErrorKind kind = says(kDiskFullReason)  ? ErrorKind::kDiskFull
                         : says(kLoadingReason) ? ErrorKind::kLoading
                                                : KindOf(status.error_code());
  return {kind, status.error_message()};
}

}  // namespace palpate
