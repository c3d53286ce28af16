// Voxels come back from zstd as they were; damage is refused.
#include "common/bricks/zstd_codec.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

TEST(ZstdCodec, RoundTripsAnyBits) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const std::vector<float>& values :
       {std::vector<float>{}, {0.0f}, {-0.0f, nan, -infinity, 1e-42f}, std::vector<float>(99999)}) {
    const std::string bytes = Compress(std::span<const float>(values));
    ASSERT_EQ(CountValues(bytes, sizeof(float), values.size()), values.size());
    std::vector<float> back(values.size(), 7.0f);
    Decompress(bytes, std::span(back));
    if (values.empty()) continue;
    EXPECT_EQ(std::memcmp(back.data(), values.data(), values.size() * sizeof(float)), 0);
    EXPECT_EQ(Refusal([&] { CountValues(bytes, sizeof(float), values.size() - 1); }),
              ErrorKind::kInvalidArgument);
    back.resize(values.size() - 1);
    EXPECT_EQ(Refusal([&] { Decompress(bytes, std::span(back)); }), ErrorKind::kInvalidArgument);
    back.resize(values.size() + 1);
    EXPECT_EQ(Refusal([&] { Decompress(bytes, std::span(back)); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(Refusal([&] { Decompress(bytes.substr(0, bytes.size() / 2), std::span(back)); }),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([&] { CountValues("", sizeof(float), 8); }), ErrorKind::kInvalidArgument);
}

}  // namespace
}  // namespace palpate
