// The thread that serves all subscribers, with transports that are fast, slow,
// stuck and gone.
#include "server/streaming/volume_streams.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <thread>

#include "client/sdk/volume_mirror.h"
#include "common/error/error.h"
#include "tests/support/editable_session.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::DifferentVoxels;
using testing::EditableSession;
using testing::Refusal;

constexpr auto kPatience = 60s;

// True as soon as `holds` does; false when it does not in time.
template <typename Holds>
bool Eventually(const Holds& holds) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!holds()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(1ms);
  }
  return true;
}

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
class Viewer {
 public:
  Viewer(VolumeStreams& streams, std::uint64_t window)
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

class VolumeStreamsTest : public ::testing::Test {
 protected:
  void SetUp() override { data_.Load("builtin:sphere:40"); }

  EditableSession data_;
  VolumeStreams streams_{data_.session()};
  std::mt19937 random_{5};
};

TEST(VolumeStreams, RefusesBeforeAVolumeAndAfterTheEnd) {
  EditableSession data;
  VolumeStreams streams(data.session());
  const auto pipe = std::make_shared<Pipe>();
  EXPECT_EQ(Refusal([&] { streams.Subscribe({}, pipe); }), ErrorKind::kUnavailable);
  data.Load("builtin:sphere:16");
  streams.Stop();
  EXPECT_EQ(Refusal([&] { streams.Subscribe({}, pipe); }), ErrorKind::kUnavailable);
  streams.Stop();
}

TEST(VolumeStreams, EachHasAnIdOfItsOwn) {
  EditableSession data;
  const VolumeStreams a(data.session()), b(data.session());
  EXPECT_NE(a.daemon_id(), b.daemon_id());
  EXPECT_NE(a.daemon_id(), 0u);
}

TEST_F(VolumeStreamsTest, ManyViewersFollowEditsOnThreadsOfTheirOwn) {
  std::atomic<bool> done{false};
  std::atomic<int> equal{0}, overlapping{0};
  std::vector<std::thread> threads;
  for (int n = 0; n < 4; ++n) {
    threads.emplace_back([&, n] {
      Viewer viewer(streams_, n == 0 ? 1 : 8);
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

TEST_F(VolumeStreamsTest, ATransportThatIsStuckHoldsNoOldVolume) {
  Viewer stuck(streams_, 64);
  Viewer quick(streams_, 4);
  std::vector<std::weak_ptr<const VolumeSnapshot>> old;
  const auto end = std::chrono::steady_clock::now() + VolumeFeed::kStall + 500ms;
  while (std::chrono::steady_clock::now() < end) {
    old.push_back(data_.RandomEdit(random_));
    ASSERT_TRUE(quick.CatchUp(data_.volume()->revision()));
  }
  EXPECT_TRUE(Eventually([&] { return streams_.old_volumes_held() == 0; }));
  const auto held = [&] {
    return std::count_if(old.begin(), old.end(), [](const auto& v) { return !v.expired(); });
  };
  EXPECT_TRUE(Eventually([&] { return held() == 1; }));
  EXPECT_GT(old.size(), 20u);
  EXPECT_TRUE(stuck.CatchUp(data_.volume()->revision()));
  EXPECT_EQ(DifferentVoxels(stuck.mirror(), *data_.volume()), 0u);
}

// Nothing wakes the thread: neither an edit, nor an acknowledgement, nor a write.
TEST(VolumeStreams, AnOldVolumeIsLetGoWhereNothingElseHappens) {
  std::atomic<int> looks{0};
  std::atomic<std::int64_t> time_ms{0};
  const auto clock = [&] {
    ++looks;
    return VolumeFeed::Clock::time_point(std::chrono::milliseconds(time_ms.load()));
  };
  EditableSession data;
  std::mt19937 random(5);
  data.Load("builtin:sphere:40");
  VolumeStreams streams(data.session(), clock);
  // The streams hear of a volume when it is published.
  data.RandomEdit(random);
  Viewer stuck(streams, 1);
  ASSERT_TRUE(Eventually([&] { return stuck.Waits(); }));
  data.RandomEdit(random);
  ASSERT_TRUE(Eventually([&] { return streams.old_volumes_held() == 1; }));
  // Looked at as often as a thread on this machine wakes up that sleeps as long.
  const int before = looks;
  for (int n = 0; n < 6; ++n) std::this_thread::sleep_for(250ms);
  EXPECT_GE(looks - before, 3);
  EXPECT_EQ(streams.old_volumes_held(), 1u);
  // It may stall for two seconds.
  time_ms = 1900;
  const int then = looks;
  EXPECT_TRUE(Eventually([&] { return looks > then + 1; }));
  EXPECT_EQ(streams.old_volumes_held(), 1u);
  time_ms = 2100;
  const int last = looks;
  EXPECT_TRUE(Eventually([&] { return looks > last + 1 || streams.old_volumes_held() == 0; }));
  EXPECT_EQ(streams.old_volumes_held(), 0u);
}

TEST_F(VolumeStreamsTest, WhoLeavesInTheMidstHoldsNothing) {
  std::weak_ptr<const VolumeSnapshot> first = data_.volume();
  {
    Viewer leaves(streams_, 4), closes(streams_, 4);
    auto dies = std::make_unique<Viewer>(streams_, 4);
    for (Viewer* viewer : {&leaves, &closes, dies.get()}) {
      ASSERT_TRUE(Eventually([&] { return viewer->Pass(); }));
    }
    leaves.Leave();
    closes.pipe().Close();
    closes.Pass();
    dies->Pass();
    dies.reset();
    data_.RandomEdit(random_);
    // The one whose transport is gone is found out by the next write, or never has
    // one and loses its hold.
    EXPECT_TRUE(Eventually([&] { return first.expired(); }));
  }
}

TEST_F(VolumeStreamsTest, TheEndReachesEverybodyWhileEditsGoOn) {
  std::atomic<bool> done{false};
  std::thread editor([&] {
    while (!done) data_.RandomEdit(random_);
  });
  std::vector<std::unique_ptr<Viewer>> viewers;
  for (int n = 0; n < 3; ++n) viewers.push_back(std::make_unique<Viewer>(streams_, 4));
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
