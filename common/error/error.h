// The only exception type of start-up and other non-real-time code.
//
// what() is one line for the user: what is wrong and what to do about it. The servo thread never
// throws; it uses status enums.
#pragma once

#include <stdexcept>
#include <string>

namespace palpate {

enum class ErrorKind {
  kInternal,
  kInvalidArgument,
  kNotFound,
  kPermissionDenied,
  kTooLarge,
  kConflict,
  kUnavailable,
  kCancelled,
  kDiskFull,
  kFailedPrecondition,  // a requirement is missing, but may be met later
  kLoading,             // palpated loads its first volume: ask again in a moment
};

class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

// Throws kInvalidArgument: an input cannot be used.
[[noreturn]] inline void Refuse(const std::string& message) {
  throw Error(ErrorKind::kInvalidArgument, message);
}

// The exit code of a program that ends with such an error. 2 is reserved for a wrong command line,
// 128 + n for signals.
constexpr int ExitCode(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kInternal:
      return 1;
    case ErrorKind::kInvalidArgument:
      return 3;
    case ErrorKind::kNotFound:
      return 4;
    case ErrorKind::kPermissionDenied:
      return 5;
    case ErrorKind::kTooLarge:
      return 6;
    case ErrorKind::kConflict:
      return 7;
    case ErrorKind::kUnavailable:
    case ErrorKind::kLoading:
      return 8;
    case ErrorKind::kCancelled:
      return 9;
    case ErrorKind::kFailedPrecondition:
      return 10;
    case ErrorKind::kDiskFull:
      return 11;
  }
  return 1;
}

// Exit code of a program whose command line was wrong.
constexpr int kUsageExitCode = 2;

}  // namespace palpate
