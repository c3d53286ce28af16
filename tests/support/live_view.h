// The live part of a viewer: its feed, and its copy of the voxels.
#pragma once

#include <vector>

#include "client/view/palpated/live_feed.h"
#include "tests/support/patience.h"

namespace palpate::test {

// Polls as frames do, until the condition holds.
template <typename Condition>
bool Follow(view::LiveFeed& feed, const Condition& holds) {
  return Eventually([&] {
    feed.Poll();
    return holds();
  });
}

// Waits until all commands are done, and pose and voxels are those after the last edit.
inline bool Settle(view::LiveFeed& feed) {
  if (!Follow(feed, [&] { return !feed.commands().busy(); })) return false;
  // Wait for a pose after the edits: the daemon answered them when the servo had used them.
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return Follow(feed, [&] {
    return feed.pose() && std::chrono::nanoseconds(feed.pose()->time_ns) > since &&
           feed.volume().revision() &&
           feed.volume().revision()->volume_revision == feed.pose()->volume_revision;
  });
}

inline std::vector<Brick> BricksOf(const view::ViewVolume& volume) {
  std::vector<Brick> bricks;
  for (std::uint64_t n = 0; n < volume.lattice()->Bricks(); ++n)
    bricks.push_back(volume.bricks().At(n)->Floats());
  return bricks;
}

}  // namespace palpate::test
