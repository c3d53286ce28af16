// palpate::Error <-> grpc::Status, in one place for servers and clients.
//
//   kInvalidArgument  INVALID_ARGUMENT      kConflict     ABORTED
//   kNotFound         NOT_FOUND             kUnavailable  UNAVAILABLE
//   kPermissionDenied PERMISSION_DENIED     kCancelled    CANCELLED
//   kTooLarge         RESOURCE_EXHAUSTED    kInternal     INTERNAL
//   kFailedPrecondition  FAILED_PRECONDITION
//   kDiskFull         RESOURCE_EXHAUSTED with the detail ErrorInfo {reason: "DISK_FULL"}
//
// Any thread.
#pragma once

#include <grpcpp/support/status.h>

#include <exception>

#include "common/error/error.h"

namespace palpate {

// Status to answer with for an exception: by kind for an Error, INTERNAL for any
// other. The message is what().
grpc::Status ToStatus(const std::exception& exception);

// The Error that a failed status stands for; the message is the status's own.
// Codes without a kind of their own go to the nearest: OUT_OF_RANGE to
// kInvalidArgument, ALREADY_EXISTS to kConflict, UNAUTHENTICATED to
// kPermissionDenied, DEADLINE_EXCEEDED and UNIMPLEMENTED to kUnavailable, the rest
// to kInternal.
Error FromStatus(const grpc::Status& status);

}  // namespace palpate
