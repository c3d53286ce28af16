// palpate::Error <-> grpc::Status, in one place for servers and clients.
//
//   kInvalidArgument  INVALID_ARGUMENT      kConflict     ABORTED
//   kNotFound         NOT_FOUND             kUnavailable  UNAVAILABLE
//   kPermissionDenied PERMISSION_DENIED     kCancelled    CANCELLED
//   kTooLarge         RESOURCE_EXHAUSTED    kInternal     INTERNAL
//   kFailedPrecondition  FAILED_PRECONDITION
//   kDiskFull         RESOURCE_EXHAUSTED with the detail ErrorInfo {reason: "DISK_FULL"}
//   kLoading          UNAVAILABLE with the detail ErrorInfo {reason: "LOADING"}
//
// Any thread.
#pragma once

#include <grpcpp/support/status.h>

#include <exception>

#include "common/error/error.h"

namespace palpate {

// Returns the status to answer with for an exception: by kind for an Error, INTERNAL for any other
// exception. The message is what().
grpc::Status ToStatus(const std::exception& exception);

// Returns the Error for a failed status, with the status's message. Codes without a kind of their
// own become the nearest kind:
//   OUT_OF_RANGE                      kInvalidArgument
//   ALREADY_EXISTS                    kConflict
//   UNAUTHENTICATED                   kPermissionDenied
//   DEADLINE_EXCEEDED, UNIMPLEMENTED  kUnavailable
//   all others                        kInternal
Error FromStatus(const grpc::Status& status);

}  // namespace palpate
