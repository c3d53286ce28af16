// The thread that serves all subscribers, with transports that are fast, slow,
// stuck and gone.
#include "server/volume_stream/volume_streams.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <thread>

#include "client/sdk/volume_mirror.h"
#include "common/error/error.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using testing::DifferentVoxels;
using testing::EditableSession;
using testing::Refusal;

// Keeps what is written until the test takes it.
class Pipe : public VolumeSink {
 public:
  bool Write(VolumeMessage message) override {
    const std::lock_guard lock(mutex_);
    if (closed_) return false;
    overlapping_ += !waiting_.empty();
    waiting_.push_back(std::move(message));
    return true;
  }
  void End() override { ended_ = true; }

  std::optional<VolumeMessage> Take() {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) return std::nullopt;
    VolumeMessage message = std::move(waiting_.front());
    waiting_.pop_front();
    return message;
  }
  void Close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  bool is_empty() const {
    const std::lock_guard lock(mutex_);
    return waiting_.empty();
  }
  bool ended() const { return ended_; }
  int overlapping() const { return overlapping_; }

 private:
  mutable std::mutex mutex_;
  std::deque<VolumeMessage> waiting_;
  bool closed_ = false;
  std::atomic<bool> ended_{false};
  std::atomic<int> overlapping_{0};
};

// A subscriber with a copy.
class StreamViewer {
 public:
  StreamViewer(VolumeStreams& streams, std::uint64_t window)
      : streams_(streams), stream_(streams.Subscribe({window, {}}, pipe_)) {}

  bool Pass() {
    std::optional<VolumeMessage> message = pipe_->Take();
    if (!message) return false;
    streams_.WriteDone(*stream_);
    mirror_.Apply(message->event);
    streams_.Acknowledge(*stream_, message->number);
    return true;
  }
  bool CatchUp(std::uint64_t revision) {
    return Eventually([&] {
      while (Pass()) {
      }
      return mirror_.is_complete() && mirror_.resume()->volume_revision == revision;
    });
  }
  bool Waits() const { return !pipe_->is_empty(); }
  void Leave() { streams_.Unsubscribe(*stream_); }
  const client::VolumeMirror& mirror() const { return mirror_; }
  Pipe& pipe() { return *pipe_; }

 private:
  VolumeStreams& streams_;
  std::shared_ptr<Pipe> pipe_ = std::make_shared<Pipe>();
  std::shared_ptr<VolumeStreams::Stream> stream_;
  client::VolumeMirror mirror_;
};

// By a clock of the test.
class VolumeStreamsTest : public ::testing::Test {
 protected:
  void SetUp() override { data_.Load("builtin:sphere:40"); }
  // Waits until the thread has looked that often what it may let go.
  bool Looks(int count) {
    return Eventually([&, before = looks_.load()] { return looks_ >= before + count; });
  }

  std::atomic<int> looks_{0};
  std::atomic<std::int64_t> time_ms_{0};
  EditableSession data_;
  VolumeStreams streams_{data_.session(), [this] {
                           ++looks_;
                           return VolumeFeed::Clock::time_point(1ms * time_ms_.load());
                         }};
  std::mt19937 random_{5};
};

TEST(VolumeStreams, RefusesBeforeAVolumeAndAfterTheEnd) {
  EditableSession data;
  VolumeStreams streams(data.session());
  EXPECT_NE(streams.daemon_id(), VolumeStreams(data.session()).daemon_id());
  EXPECT_NE(streams.daemon_id(), 0u);
  const auto pipe = std::make_shared<Pipe>();
  EXPECT_EQ(Refusal([&] { streams.Subscribe({}, pipe); }), ErrorKind::kLoading);
  data.Load("builtin:sphere:16");
  streams.Stop();
  EXPECT_EQ(Refusal([&] { streams.Subscribe({}, pipe); }), ErrorKind::kUnavailable);
  streams.Stop();
}

TEST_F(VolumeStreamsTest, ManyViewersFollowEditsOnThreadsOfTheirOwn) {
  std::atomic<bool> done{false};
  std::atomic<int> equal{0}, overlapping{0};
  std::vector<std::thread> threads;
  for (int n = 0; n < 4; ++n) {
    threads.emplace_back([&, n] {
      StreamViewer viewer(streams_, n == 0 ? 1 : 8);
      while (!done) {
        if (!viewer.Pass() || n == 1) std::this_thread::sleep_for(1ms);
      }
      const std::uint64_t newest = data_.volume()->revision();
      equal += viewer.CatchUp(newest) && DifferentVoxels(viewer.mirror(), *data_.volume()) == 0;
      overlapping += viewer.pipe().overlapping();
      viewer.Leave();
    });
  }
  for (int n = 0; n < 400; ++n) {
    data_.RandomEdit(random_);
    if (n == 200) data_.Load("builtin:bumps:32");
    std::this_thread::sleep_for(1ms);
  }
  done = true;
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(equal, 4);
  EXPECT_EQ(overlapping, 0);
  EXPECT_TRUE(Eventually([&] { return streams_.streams() == 0; }));
}

// Nothing wakes the thread: neither an edit, nor an acknowledgement, nor a write.
TEST_F(VolumeStreamsTest, AnOldVolumeIsLetGoWhereNothingElseHappens) {
  const std::weak_ptr<const VolumeSnapshot> old = data_.RandomEdit(random_);
  StreamViewer stuck(streams_, 1);
  ASSERT_TRUE(Eventually([&] { return stuck.Waits(); }));
  data_.RandomEdit(random_);
  ASSERT_TRUE(Eventually([&] { return streams_.old_volumes_held() == 1; }));
  ASSERT_TRUE(Looks(4));
  // It may stall for two seconds.
  for (const auto& [ms, held] : {std::pair(1900, 1u), std::pair(2100, 0u)}) {
    time_ms_ = ms;
    EXPECT_TRUE(held == 0u ? Eventually([&] { return streams_.old_volumes_held() == 0; })
                           : Looks(2));
    EXPECT_EQ(streams_.old_volumes_held(), held);
    EXPECT_TRUE(held == 1u || Eventually([&] { return old.expired(); }));
  }
  EXPECT_TRUE(stuck.CatchUp(data_.volume()->revision()));
  EXPECT_EQ(DifferentVoxels(stuck.mirror(), *data_.volume()), 0u);
}

TEST_F(VolumeStreamsTest, WhoLeavesInTheMidstHoldsNothing) {
  std::weak_ptr<const VolumeSnapshot> first = data_.volume();
  {
    StreamViewer leaves(streams_, 4), closes(streams_, 4);
    auto dies = std::make_unique<StreamViewer>(streams_, 4);
    for (StreamViewer* viewer : {&leaves, &closes, dies.get()}) {
      ASSERT_TRUE(Eventually([&] { return viewer->Pass(); }));
    }
    leaves.Leave();
    closes.pipe().Close();
    closes.Pass();
    dies->Pass();
    dies.reset();
    data_.RandomEdit(random_);
    // The one whose transport is gone is found out by the next write, or never has one and loses
    // its hold. Time goes on: the thread may note only now that somebody stalls.
    EXPECT_TRUE(Eventually([&] {
      time_ms_ += 10'000;
      return first.expired();
    }));
  }
}

TEST_F(VolumeStreamsTest, TheEndReachesEverybodyWhileEditsGoOn) {
  std::atomic<bool> done{false};
  std::thread editor([&] {
    while (!done) data_.RandomEdit(random_);
  });
  std::vector<std::unique_ptr<StreamViewer>> viewers;
  for (int n = 0; n < 3; ++n) viewers.push_back(std::make_unique<StreamViewer>(streams_, 4));
  for (int n = 0; n < 100; ++n) {
    for (const auto& viewer : viewers) viewer->Pass();
  }
  streams_.Stop();
  for (const auto& viewer : viewers) EXPECT_TRUE(viewer->pipe().ended());
  EXPECT_EQ(streams_.streams(), 0u);
  done = true;
  editor.join();
}

}  // namespace
}  // namespace palpate
