// The copy of the volume that the client library hands out, against the daemon's own.
#include <gtest/gtest.h>

#include <atomic>
#include <bit>
#include <fstream>

#include "client/sdk/client.h"
#include "tests/support/patience.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::RestartedDaemon;

// What a viewer keeps of the updates.
class Viewer {
 public:
  // True where the copy is complete, and that of `revision` at least.
  bool Take(Client& client, std::uint64_t revision) {
    while (const auto update = client.TakeVolumeUpdate()) {
      anew_ += update->all && update->lattice;
      if (update->all) {
        auto background = std::make_shared<Brick>();
        background->fill(update->lattice ? update->lattice->Background() : 0.0f);
        bricks_.assign(update->lattice ? update->lattice->Bricks() : 0, background);
      }
      for (const ChangedBrick& changed : update->bricks) bricks_[changed.number] = changed.brick;
      received_ += update->bricks.size();
      complete_ = update->complete;
      placed_ = update->placement.has_value();
    }
    return complete_ && complete_->volume_revision >= revision;
  }
  std::uint64_t DifferentBricks(const Viewer& other) const {
    if (bricks_.size() != other.bricks_.size()) return ~std::uint64_t{0};
    std::uint64_t different = 0;
    for (std::size_t n = 0; n < bricks_.size(); ++n) different += *bricks_[n] != *other.bricks_[n];
    return different;
  }
  std::size_t bricks() const { return bricks_.size(); }
  float Value(std::uint64_t number, int i, int j, int k) const {
    return (*bricks_[number])[VoxelInBrick(i, j, k)];
  }
  std::size_t received() const { return received_; }
  int anew() const { return anew_; }
  bool placed() const { return placed_; }

 private:
  std::vector<BrickPtr> bricks_;
  std::optional<VolumeRevision> complete_;
  std::size_t received_ = 0;
  int anew_ = 0;
  bool placed_ = false;
};

ClientOptions Follow(const RestartedDaemon& daemon) {
  return {.address = {.socket_path = daemon.socket()}, .follow_volume = true};
}

// A client that comes anew holds the daemon's volume, as its hash has shown.
std::uint64_t DifferentFromAFreshCopy(const RestartedDaemon& daemon, const Viewer& viewer,
                                      std::uint64_t revision) {
  Client fresh(Follow(daemon));
  Viewer truth;
  EXPECT_TRUE(Eventually([&] { return truth.Take(fresh, revision); }));
  return viewer.DifferentBricks(truth);
}

Edit Dab(int n) {
  Edit edit;
  edit.shape = Sphere{Vec3(6 + n * 7 % 36, 6 + n * 11 % 36, 6 + n * 13 % 36), 4.0};
  edit.frame = EditFrame::kIndex;
  edit.operation = EditOperation::kSet;
  edit.value = 0.1 + 0.8 * (n % 10) / 10;
  edit.falloff = 1.0;
  return edit;
}

TEST(SdkVolume, FollowsEditsAndUndo) {
  RestartedDaemon daemon;
  daemon.Start();
  std::atomic<int> notices{0};
  ClientOptions options = Follow(daemon);
  options.callbacks.on_volume = [&] { ++notices; };
  Client client(options);
  Client editor({.address = {.socket_path = daemon.socket()}});
  ASSERT_TRUE(client.WaitUntilConnected(60s) && editor.WaitUntilConnected(60s));
  Viewer viewer;
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1); }));
  EXPECT_EQ(viewer.bricks(), 216u);
  EXPECT_TRUE(viewer.placed());
  EXPECT_TRUE(client.volume_status().complete);
  EXPECT_EQ(client.volume_status().problem, "");
  EXPECT_GT(client.volume_status().bytes_received, 1000u);
  const std::size_t first = viewer.received();
  const int noticed = notices;

  Edit block;
  block.shape = Block{Vec3i(8, 0, 0), Vec3i(1, 1, 2), {0.25f, 0.5f}};
  block.operation = EditOperation::kSet;
  const EditResult one = editor.Apply(block);
  ASSERT_TRUE(one.changed);
  EXPECT_EQ(one.changed->min, Vec3i(8, 0, 0));
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, one.volume_revision); }));
  EXPECT_GT(notices, noticed);
  EXPECT_EQ(viewer.received(), first + 1);
  EXPECT_EQ(viewer.Value(36, 0, 0, 0), 0.25f);

  // It is not even sent.
  block.shape = Block{Vec3i(0, 0, 0), Vec3i(16, 16, 4096), std::vector<float>(1 << 20)};
  try {
    editor.Apply(block);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kTooLarge);
    // Not in the words of gRPC, which are those of a message that was sent.
    EXPECT_STREQ(error.what(), "a block has at most 3 MiB of values: send it in parts");
  }

  EditResult last;
  for (int n = 0; n < 100; ++n) last = editor.Apply(Dab(n));
  EXPECT_EQ(last.undo_steps, 101u);
  last = editor.Undo();
  last = editor.Redo();
  last = editor.Undo();
  EXPECT_EQ(last.redo_steps, 1u);
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, last.volume_revision); }));
  EXPECT_EQ(DifferentFromAFreshCopy(daemon, viewer, last.volume_revision), 0u);
  EXPECT_EQ(viewer.anew(), 1);

  Viewer original;
  last = editor.Revert();
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, last.volume_revision); }));
  EXPECT_EQ(DifferentFromAFreshCopy(daemon, viewer, last.volume_revision), 0u);
}

TEST(SdkVolume, AnotherDaemonOnTheSocketIsFollowedAnew) {
  RestartedDaemon daemon;
  daemon.Start();
  Client client(Follow(daemon));
  Viewer viewer;
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1); }));
  const EditResult edited = client.Apply(Dab(3));
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, edited.volume_revision); }));
  daemon.Kill();
  ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
  daemon.Start();
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  // Its voxels are those before the edit, which it never saw.
  ASSERT_TRUE(Eventually([&] {
    viewer.Take(client, 1);
    return viewer.anew() == 2 && viewer.Take(client, 1);
  }));
  EXPECT_EQ(DifferentFromAFreshCopy(daemon, viewer, 1), 0u);
}

TEST(SdkVolume, ResumesFromItsRevisionAfterAHang) {
  RestartedDaemon daemon;
  daemon.Start();
  Client client(Follow(daemon));
  Viewer viewer;
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1); }));
  const std::size_t first = viewer.received();
  daemon.Hang();
  ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
  daemon.Continue();
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  const EditResult edited = client.Apply(Dab(5));
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, edited.volume_revision); }));
  // The same volume of the same daemon: only what changed came.
  EXPECT_EQ(viewer.anew(), 1);
  EXPECT_LT(viewer.received(), first + 40);
  EXPECT_EQ(DifferentFromAFreshCopy(daemon, viewer, edited.volume_revision), 0u);
}

TEST(SdkVolume, AClientWithoutACopyHandsOutNone) {
  RestartedDaemon daemon;
  daemon.Start();
  Client client({.address = {.socket_path = daemon.socket()}});
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  EXPECT_FALSE(client.TakeVolumeUpdate());
}

}  // namespace
}  // namespace palpate::client
