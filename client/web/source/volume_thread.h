// The volume thread: takes the client's changes and makes manifests of them.
//
// A manifest begins at most 20 times a second. While another volume comes, what is told of the last
// one stays: lattice, placement and manifest of the next one are told together.
//
// Threads: Wake and Find on any; `on_news` is called on the volume thread. Ownership: borrows all.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>

#include "client/sdk/client.h"
#include "client/web/volume/grouped_volume.h"

namespace palpate::web {

// What is new; none: as before.
struct VolumeNews {
  std::optional<VolumeLattice> lattice{};  // another volume
  std::optional<VolumePlacement> placement{};
  std::optional<ManifestInfo> manifest{};
  std::uint64_t bricks_left = 0;
  client::VolumeStatus status{};
};

// Outlives the client, whose callback raises it.
class VolumeSignal {
 public:
  void Raise();
  void Stop();
  // Returns false after Stop. Waits until raised, at most for `time`; takes the signal.
  bool Wait(std::chrono::milliseconds time);
  // Returns false after Stop. Waits for `time`.
  bool Pause(std::chrono::milliseconds time);

 private:
  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_raised_ = false;
  bool is_stopping_ = false;
};

class VolumeThread {
 public:
  VolumeThread(client::Client& client, VolumeSignal& signal, bool with_groups,
               std::function<void(const VolumeNews&)> on_news);
  // Stops the signal.
  ~VolumeThread();
  VolumeThread(const VolumeThread&) = delete;
  VolumeThread& operator=(const VolumeThread&) = delete;

  BlobPtr Find(std::string_view name) const { return volume_.Find(name); }

 private:
  void Run();
  VolumeNews NewsOf(const client::VolumeUpdate& update);

  client::Client& client_;
  VolumeSignal& signal_;
  const std::function<void(const VolumeNews&)> on_news_;
  GroupedVolume volume_;
  std::optional<VolumeLattice> held_lattice_;  // not told yet
  bool has_manifest_ = false;
  std::thread thread_;
};

}  // namespace palpate::web
