// Everything that the viewer knows of palpated, from the client library. Asked once per frame.
//
// Threads: one, except inside the client library. Errors: those of client::Client's constructor. An
// absent daemon is a state.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/client.h"
#include "client/sdk/hand_lead.h"
#include "client/sdk/server_choice.h"
#include "client/view/palpated/commands.h"
#include "client/view/palpated/emergency_stop.h"
#include "client/view/palpated/plot_history.h"
#include "client/view/palpated/replayer.h"
#include "client/view/palpated/shared_things.h"
#include "client/view/palpated/volume_loader.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

class LiveFeed {
 public:
  explicit LiveFeed(const client::ServerChoice& server);
  ~LiveFeed();

  // Connects to another palpated, or anew to the same one. From then on all data are from the new
  // connection; until they arrive there are none. Errors: as the constructor's; nothing has changed
  // then.
  void Connect(const client::ServerChoice& server);
  // Ends the connection until Connect. The shown data stay.
  void Disconnect();
  bool is_disconnected() const { return is_disconnected_; }
  // True while an emergency stop is running. Do not call Connect or Disconnect then.
  bool is_stopping() const;

  // Takes what came since the last call. Does not wait.
  void Poll();
  // From now on Poll takes the volume only when it is complete: volume() is never half of an edit.
  void AwaitWhole() { awaits_whole_ = true; }

  client::Connection connection() const;
  // The number of losses so far, including those between two calls of Poll.
  std::uint64_t losses() const { return losses_; }
  std::string name() const;
  // True if palpated is reached by a socket of this machine.
  bool is_here() const;
  const std::optional<client::Pose>& pose() const { return pose_; }
  const std::optional<client::Settings>& settings() const { return settings_; }
  client::VolumeStatus volume_status() const;
  const ViewVolume& volume() const { return volume_; }
  ViewVolume& volume() { return volume_; }
  const PlotHistory& plots() const { return plots_; }
  // The age of the newest pose; none over TCP, because the clocks may differ.
  std::optional<double> stream_age_ms() const;
  std::uint64_t dropped_poses() const;
  // The time since the newest pose came, if it is longer than kSilence although palpated is
  // connected: palpated hangs.
  static constexpr std::chrono::milliseconds kSilence{500};
  std::optional<double> silent_s() const;
  // The time now on the clock of Pose::time_ns; the plots end there. 0 before the first pose.
  std::int64_t plots_end_ns() const;

  // As of the last Poll; none and null: not known, or the daemon is away.
  const client::Hand* device() const;
  const std::optional<client::SeriesState>& series() const { return facts_->series; }
  const std::optional<client::RecordingState>& recording() const { return facts_->recording; }
  const std::optional<client::VolumeInfo>& volume_info() const { return facts_->volume; }
  const std::optional<client::Activity>& activity() const { return facts_->activity; }
  // Why palpated tells none of these; empty: it does.
  const std::string& facts_problem() const { return facts_->problem; }
  // Who we are at palpated.
  const client::CallerDescription& caller() const { return facts_->caller; }
  // The newest pose is of a replay, whoever runs it; false while nothing comes.
  bool is_replay() const;

  // Who changed what for everyone, as of the last Poll.
  const SharedThings& shared() const { return shared_; }
  SharedThings& shared() { return shared_; }

  // kUnknown until palpated has sent it.
  client::Role role() const { return caller().role; }
  // False if our role is known to be less than `least`, and while disconnected.
  bool May(client::Role least) const {
    return !is_disconnected() && (role() == client::Role::kUnknown || role() >= least);
  }

  const Commands& commands() const;
  Commands& commands();
  // Merges the change with waiting changes, key by key: the newest position of a slider wins.
  void ControlSeries(const client::SeriesControl& control);
  // Changes for everyone. These and those below are known to shared() as ours.
  // `kind`: the device's name, if its forces were never verified; otherwise empty.
  void EnableForces(const std::string& kind);
  void DisableForces();
  // The emergency stop.
  void StopForces();
  void StartRecording(const std::string& path);
  void StopRecording();
  // Takes the simulated hand at palpated, in the background. hand() is null before TakeHand, after
  // GiveHandBack, and on another connection.
  void TakeHand();
  void GiveHandBack();
  client::HandLead* hand();
  // The filter of the volume that runs.
  Task<client::EditResult>& filter();
  VolumeLoader& loader();
  const VolumeLoader& loader() const;
  Replayer& replayer();
  const Replayer& replayer() const;
  const EmergencyStop& emergency_stop() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Line;

  std::atomic<std::uint64_t> losses_{0};  // counted on the client's thread, too
  std::unique_ptr<Line> line_;
  bool is_disconnected_ = false;
  std::optional<client::Pose> pose_;
  Clock::time_point pose_came_{};
  Clock::time_point connected_at_{};
  Clock::time_point polled_at_{};
  bool was_connected_ = false;
  std::optional<client::Settings> settings_;
  ViewVolume volume_;
  bool awaits_whole_ = false;
  std::optional<client::VolumeUpdate> waiting_;  // that the volume has not taken
  PlotHistory plots_;
  std::shared_ptr<const client::Facts> facts_ = std::make_shared<const client::Facts>();
  SharedThings shared_;
};

}  // namespace palpate::view
