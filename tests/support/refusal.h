// What a call refuses, and how.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "common/error/error.h"

namespace palpate::testing {

// The Error that the call throws, if any.
inline std::optional<Error> Thrown(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error;
  }
  return std::nullopt;
}

// Its kind. Empty if the call throws no Error.
inline std::optional<ErrorKind> Refusal(const std::function<void()>& call) {
  const std::optional<Error> error = Thrown(call);
  return error ? std::optional(error->kind()) : std::nullopt;
}

// Its line. Empty if the call throws no Error.
inline std::string Complaint(const std::function<void()>& call) {
  const std::optional<Error> error = Thrown(call);
  return error ? error->what() : "";
}

}  // namespace palpate::testing
