// Names and times of the session panel.
#include "client/view/palpated/session_words.h"

#include <gtest/gtest.h>

#include <string>

namespace palpate::view {
namespace {

TEST(ViewSessionWords, Times) {
  EXPECT_EQ(TimeText(0), "0:00");
  EXPECT_EQ(TimeText(999), "0:00");
  EXPECT_EQ(TimeText(12'000), "0:12");
  EXPECT_EQ(TimeText(100'000), "1:40");
  EXPECT_EQ(TimeText(3'599'999), "59:59");
  EXPECT_EQ(TimeText(3'723'000), "1:02:03");
  EXPECT_EQ(SizeText(340'000), "340 kB");
  EXPECT_EQ(SizeText(1'240'000), "1.2 MB");
}

TEST(ViewSessionWords, ANameIsAFileInTheDaemonsFolder) {
  EXPECT_EQ(RecordingPath("/data", "a"), "/data/a.mcap");
  EXPECT_EQ(RecordingPath("/", "a.mcap"), "/a.mcap");
  EXPECT_EQ(RecordingName("/data/a b.mcap"), "a b");
  EXPECT_EQ(RecordingName("/data/other"), "other");
  EXPECT_EQ(RecordingName(".mcap"), ".mcap");
}

TEST(ViewSessionWords, ATakenNameIsRefusedAndTheNextOneIsFree) {
  const client::RecordingList list = {
      {{"/data/a.mcap"}, {"/data/a-2.mcap"}, {"/data/b-9.mcap"}, {"/x/c.mcap"}}, "/data"};
  EXPECT_EQ(FreeName("a", list), "a-3");
  EXPECT_EQ(FreeName("a.mcap", list), "a-3");
  EXPECT_EQ(FreeName("a-2", list), "a-3");
  EXPECT_EQ(FreeName("b-9", list), "b-10");
  EXPECT_EQ(FreeName("c", list), "c");
  EXPECT_NE(NameProblem("a", list), "");
  EXPECT_NE(NameProblem("a.mcap", list), "");
  EXPECT_NE(NameProblem("", list), "");
  EXPECT_NE(NameProblem("../x", list), "");
  EXPECT_EQ(NameProblem("c", list), "");
  EXPECT_NE(NameProblem("c", {}), "");
  // Whatever is taken, there is a free one.
  client::RecordingList many{{{"/d/-1.mcap"}, {"/d/t.mcap"}, {"/d/t-999999.mcap"}}, "/d"};
  for (const char* name : {"-1", "t", "t-999999"}) {
    const std::string free = FreeName(name, many);
    EXPECT_EQ(NameProblem(free, many), "") << free;
  }
}

TEST(RecordingWatch, SaysBeginAndEndOnce) {
  RecordingWatch watch;
  EXPECT_EQ(watch.Take(false), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kBegun);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kEnded);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kNone);
}

TEST(RecordingWatch, NoAnswerIsNoEnd) {
  RecordingWatch watch;
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  watch.Take(true);
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kEnded);
}

}  // namespace
}  // namespace palpate::view
