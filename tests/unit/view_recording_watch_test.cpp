// What the viewer takes for the end of a recording.
#include "client/view/live/session_words.h"

#include <gtest/gtest.h>

namespace palpate::view {
namespace {

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
