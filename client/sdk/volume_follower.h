// The volume thread: keeps a copy of the volume while palpated is reached.
//
// Threads: one of its own; call all methods from any. Ownership: borrows its arguments. Call
// Begin() once. Call End() before the arguments are destroyed.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "client/sdk/link.h"
#include "client/sdk/monitor.h"
#include "client/sdk/volume_copy.h"
#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"

namespace palpate::client {

class VolumeFollower {
 public:
  VolumeFollower(Link& link, Monitor& monitor, std::function<void()> on_volume);
  ~VolumeFollower() { End(); }

  void Begin();
  // Joins the thread. Call it after Monitor::Stop.
  void End();

  std::optional<VolumeUpdate> Take() { return copy_.Take(); }
  VolumeStatus status() const;

 private:
  void Run();
  void Follow(std::uint64_t epoch);
  void Say(const VolumeReader* reader, const std::string& problem);

  Link& link_;
  Monitor& monitor_;
  const std::function<void()> on_volume_;
  VolumeMirror mirror_;             // used by the volume thread only
  std::uint64_t bytes_before_ = 0;  // by ended readers
  VolumeCopy copy_;

  mutable std::mutex mutex_;
  VolumeStatus status_;

  std::thread thread_;
};

}  // namespace palpate::client
