// What a call refused: the kind of its Error.
#pragma once

#include <functional>
#include <optional>

#include "common/error/error.h"

namespace palpate::testing {

// Empty where the call did not throw an Error.
inline std::optional<ErrorKind> Refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.kind();
  }
  return std::nullopt;
}

}  // namespace palpate::testing
