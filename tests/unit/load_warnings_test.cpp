// Warnings of an import, as clients are told them.
#include "server/store/load_warnings.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

using Lines = std::vector<std::string>;

TEST(LoadWarnings, TheSourceInFrontIsLeftOut) {
  const Lines warnings = {"/tmp/a.nrrd: no spacing", "no spacing of /tmp/a.nrrd: 1 mm"};
  EXPECT_EQ(WarningsForClients(warnings, "/tmp/a.nrrd"),
            Lines({"no spacing", "no spacing of /tmp/a.nrrd: 1 mm"}));
}

TEST(LoadWarnings, AreFewAndTheRestIsCounted) {
  EXPECT_TRUE(WarningsForClients({}, "a").empty());
  EXPECT_EQ(WarningsForClients(Lines(16, "x"), "a"), Lines(16, "x"));
  Lines expected(15, "x");
  expected.push_back("and 3 more");
  EXPECT_EQ(WarningsForClients(Lines(18, "x"), "a"), expected);
}

TEST(LoadWarnings, AreShortAndWholeCharacters) {
  const Lines warnings = {std::string(1000, 'x'), "y" + std::string(1000, '\n')};
  EXPECT_EQ(WarningsForClients(warnings, "a"),
            Lines({std::string(300, 'x'), "y" + std::string(299, ' ')}));
  std::string wide = "xx";
  for (int k = 0; k < 500; ++k) wide += "\u00e4";
  EXPECT_EQ(WarningsForClients(Lines{wide}, "a"), Lines{wide.substr(0, 300)});
  EXPECT_EQ(WarningsForClients(Lines{"x" + wide}, "a"), Lines{("x" + wide).substr(0, 299)});
}

TEST(LoadWarnings, AreUtf8WhateverAFileHolds) {
  const Lines good = {"\u00e4 \u20ac \U0001f600 \ud7ff \ue000 \U0010ffff"};
  EXPECT_EQ(WarningsForClients(good, "a"), good);
  const Lines bad = {"\xff",         "\xc0\x80",         "\xe0\x80\x80",
                     "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xe2\x82"};
  const Lines expected = {"?", "??", "???", "???", "????", "??"};
  EXPECT_EQ(WarningsForClients(bad, "a"), expected);
}

}  // namespace
}  // namespace palpate
