// The refusals of the importer's parsers.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "common/error/error.h"

namespace palpate::testing {

// Returns the message, or "" if nothing was refused. Every refusal is one line.
template <typename Parse>
std::string Refusal(const Parse& parse) {
  try {
    parse();
  } catch (const Error& error) {
    const std::string what = error.what();
    EXPECT_TRUE(error.kind() == ErrorKind::kInvalidArgument ||
                error.kind() == ErrorKind::kTooLarge);
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
    EXPECT_FALSE(what.empty());
    return what;
  }
  return {};
}

}  // namespace palpate::testing
