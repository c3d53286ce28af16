// palpated as the source of what guests see: follows it by the client library.
//
// Threads: methods on the network thread, unless stated. `post` runs a function on the network
// thread; none runs before the constructor has returned. The source must live until no posted
// function runs any more. Ownership: borrows the hub.
// Errors: those of client::Client's constructor.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "client/sdk/client.h"
#include "client/web/hub/hub.h"
#include "client/web/upstream/source.h"
#include "client/web/upstream/stopper.h"
#include "client/web/upstream/topic_text.h"
#include "client/web/upstream/worker.h"
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

// The volume thread: takes the client's changes and makes manifests of them.
//
// A manifest begins at most 20 times a second. While another volume comes, what is told of the last
// one stays: lattice, placement and manifest of the next one are told together.
//
// Threads: Find on any; `on_news` is called on the volume thread. Ownership: borrows the client.
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

struct PalpatedOptions {
  client::ServerChoice server{};
  bool with_groups = true;  // false: guests see the overview alone
  bool steers = false;      // some user may change settings
  std::string version{};
  // On the network thread; one line each.
  std::function<void(const std::string& line)> log{};
  std::function<void(bool is_accepted)> steered{};
};

class PalpatedSource final : public Source {
 public:
  PalpatedSource(PalpatedOptions options, Hub& hub, Post post);
  ~PalpatedSource() override;
  PalpatedSource(const PalpatedSource&) = delete;
  PalpatedSource& operator=(const PalpatedSource&) = delete;

  BlobPtr FindBlob(std::string_view name) const override { return volume_->Find(name); }
  // While palpated takes a change, a user's newest change of a key replaces the same user's one
  // that waits; that is done then.
  void Steer(const SteerRequest& request, std::function<void(std::string error)> done) override;
  std::string Health() const override { return PlainWhy(connection_.state); }
  bool is_copy_complete() const override { return client_->volume_status().complete; }

 private:
  client::ClientOptions Options();
  void TakePoses(const client::PoseBatch& batch);
  void PutPose(bool is_fresh);
  void PutConnection(const client::Connection& connection);
  void PutConnectionText();
  void PutFacts(const client::Facts& facts);
  void CheckRights(client::Role role);
  void PutVolume(const VolumeNews& news);
  void PutHeld();
  void Stop(const SteerRequest& request, std::function<void(std::string error)> done);
  void PutSteered(const SteerRequest& request, const std::string& error);

  const PalpatedOptions options_;
  Hub& hub_;
  const Post post_;
  client::Connection connection_;
  std::int64_t connection_since_ms_ = 0;
  std::optional<VolumeLattice> lattice_;
  std::optional<std::string> info_;  // the newest volume's, as guests get it
  std::uint64_t info_revision_ = 0;  // its loaded_revision
  // Of the newest lattice's volume. Its voxels do not come under the name of the last one.
  enum class Name : std::uint8_t { kAwaited, kMissing, kPut };
  Name name_ = Name::kPut;
  std::string placement_, manifest_;  // empty: nothing new
  client::Role role_ = client::Role::kUnknown;
  std::string facts_problem_;
  std::deque<SteeredChange> steered_;
  std::string problem_;

  std::mutex pose_mutex_;
  client::Pose pose_;            // the newest
  bool is_pose_posted_ = false;  // PutPose will run

  std::unique_ptr<client::Client> client_;
  std::unique_ptr<VolumeThread> volume_;
  std::unique_ptr<Worker> worker_;
  std::unique_ptr<Stopper> stopper_;
};

}  // namespace palpate::web
