// The volume thread: takes the client's changes and makes manifests of them.
//
// A manifest begins at most 20 times a second. While another volume comes, what is told of the last
// one stays: lattice, placement and manifest of the next one are told together.
//
// Threads: Find on any; `on_news` is called on the volume thread. Ownership: borrows the client.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string>
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
  client::VolumeStatus status{};
  // Why the change before was not taken: memory is short. The last manifest stays until the next.
  std::string failure{};
};

class VolumeThread {
 public:
  VolumeThread(client::Client& client, bool with_groups,
               std::function<void(const VolumeNews&)> on_news);
  ~VolumeThread();
  VolumeThread(const VolumeThread&) = delete;
  VolumeThread& operator=(const VolumeThread&) = delete;

  BlobPtr Find(std::string_view name) const { return volume_.Find(name); }

 private:
  void Run();
  bool Look(std::chrono::steady_clock::time_point now);
  VolumeNews NewsOf(const client::VolumeUpdate& update);

  client::Client& client_;
  const std::function<void(const VolumeNews&)> on_news_;
  GroupedVolume volume_;
  std::optional<VolumeLattice> held_lattice_;  // not told yet
  bool has_manifest_ = false;
  std::string problem_, failure_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace palpate::web
