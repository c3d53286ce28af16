#include "common/error/number_text.h"

#include <cstdlib>
#include <random>

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(NumberText, HasAllDigitsThatMatter) {
  EXPECT_EQ(NumberText(-48123.450825), "-48123.450825");
  EXPECT_EQ(NumberText(4080123456.450825), "4080123456.450825");
  EXPECT_EQ(NumberText(0.1 + 0.2), "0.3");
  EXPECT_EQ(NumberText(1234567.875), "1234567.875");
  EXPECT_EQ(NumberText(0.1f), "0.1");
  EXPECT_EQ(NumberText(-1024), "-1024");
  EXPECT_EQ(NumberText(0), "0");
  EXPECT_EQ(NumberText(std::nan("")), "nan");
  std::mt19937 random(1);
  std::uniform_real_distribution<float> any(-1e5f, 1e5f);
  for (int n = 0; n < 1000; ++n) {
    const float number = any(random);
    EXPECT_EQ(std::strtof(NumberText(number).c_str(), nullptr), number);
  }
}

}  // namespace
}  // namespace palpate
