// A session without a servo. Tests edit its volume at random.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/session/session.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/made_volume.h"
#include "tests/support/voxels.h"

namespace palpate::testing {

inline const LoadProgress kQuiet = [](std::string_view, double) {};
inline const LoadCancelled kNever = [] { return false; };

class EditableSession {
 public:
  explicit EditableSession(VolumeLoader loader = {})
      : session_(device_, inbox_, pump_, std::move(loader)) {
    inbox_.ReaderStopped();
  }

  Session& session() { return session_; }
  SceneInbox& inbox() { return inbox_; }
  TickOutbox& outbox() { return *outbox_; }
  Pump& pump() { return pump_; }
  const DeviceDescription& device() const { return device_; }
  std::shared_ptr<const VolumeSnapshot> volume() const { return session_.volume().volume; }
  ContentHash hash() const { return volume()->bricks().content_hash(); }

  void Load(const std::string& source) {
    session_.Load({.source = source, .discards_edits = true}, kQuiet, kNever);
  }

  // Loads a volume with value(i, j, k) for each voxel.
  void LoadMade(const Vec3i& size, const std::function<float(int, int, int)>& value) {
    VolumeMetadata metadata;
    metadata.size = size;
    metadata.source = "made";
    session_.PublishVolume({.source = {}, .discards_edits = true}, metadata,
                           MakeBricks(size, value));
  }

  // Edits a box of up to `edge` voxels along each axis. One edit in four writes background.
  // Returns the newest snapshot.
  std::shared_ptr<const VolumeSnapshot> RandomEdit(std::mt19937& random, int edge = 16) {
    session_.store().Edit([&](const auto& present) -> VolumeChange {
      const Vec3i& size = present->size();
      Vec3i from, end;
      for (int axis = 0; axis < 3; ++axis) {
        from[axis] = static_cast<int>(random() % size[axis]);
        end[axis] = std::min<int>(size[axis], from[axis] + 1 + static_cast<int>(random() % edge));
      }
      const bool clears = random() % 4 == 0;
      const auto value = [&] {
        return clears ? 0.0f : static_cast<float>(random() % 1000) * 1e-3f;
      };
      VolumeChange change(PaintedBox(present->bricks(), from, end, value));
      change.kind = VolumeChange::Kind::kEdit;
      return change;
    });
    return volume();
  }

 private:
  DeviceDescription device_ = SimulatedDeviceSpec();
  SceneInbox inbox_;
  std::unique_ptr<TickOutbox> outbox_ = std::make_unique<TickOutbox>();
  Pump pump_{*outbox_, inbox_};
  Session session_;
};

// Counts the voxels of the lattice whose bits differ.
template <typename Mirror>
std::uint64_t DifferentVoxels(const Mirror& mirror, const VolumeSnapshot& volume) {
  std::uint64_t different = 0;
  ForEachVoxel(volume.size(), [&](const Vec3i& p) {
    different += std::bit_cast<std::uint32_t>(mirror.bricks().Value(p.x(), p.y(), p.z())) !=
                 std::bit_cast<std::uint32_t>(ValueAt(volume, p));
  });
  return different;
}

}  // namespace palpate::testing
