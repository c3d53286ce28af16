// The kind of the Error that a call throws.
#pragma once

#include <functional>
#include <optional>

#include "common/error/error.h"

namespace palpate::testing {

// Empty if the call throws no Error.
inline std::optional<ErrorKind> Refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.kind();
  }
  return std::nullopt;
}

}  // namespace palpate::testing
