// Checks that numbers lie within a range, with one wording for all errors.
//
// Threads: any. Errors: RangeError, which names the number.
#pragma once

#include <fmt/core.h>

#include <string>
#include <string_view>

#include "common/error/error.h"
#include "common/error/number_text.h"

namespace palpate {

class RangeError : public Error {
 public:
  RangeError(std::string_view name, const std::string& message)
      : Error(ErrorKind::kInvalidArgument, message), name_(name) {}
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

// `unit`: with a leading blank, or empty. Also refuses NaN.
inline void CheckRange(std::string_view name, double value, double low, double high,
                       std::string_view unit) {
  if (value >= low && value <= high) return;
  throw RangeError(name, fmt::format("{} {} is not within {} to {}{}", name, value, NumberText(low),
                                     NumberText(high), unit));
}

}  // namespace palpate
