// All that the viewer knows of palpated, taken from the client library alone; asked
// once per frame.
//
// Threads: one, but for what the client library does behind it. Errors: those of
// client::Client's constructor; a daemon that is away is a state.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/client.h"
#include "client/sdk/server_choice.h"
#include "client/view/live/commands.h"
#include "client/view/live/denoiser.h"
#include "client/view/live/emergency_stop.h"
#include "client/view/live/plot_history.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

class LiveFeed {
 public:
  explicit LiveFeed(const client::ServerChoice& server);
  ~LiveFeed();

  // To another palpated, or the same one anew; from then on all is that one's, and
  // nothing until it comes. Errors: as the
  // constructor's, and nothing has changed.
  void Connect(const client::ServerChoice& server);
  // Until Connect. What was shown stays.
  void Disconnect();
  bool is_disconnected() const;
  // An emergency stop is under way, which neither of the two may cut short.
  bool is_stopping() const;

  // Takes up what came since the last call. Waits for nothing.
  void Poll();

  client::Connection connection() const;
  // How often it was lost so far, also between two calls of Poll.
  std::uint64_t losses() const;
  const std::string& name() const;
  const std::optional<client::Pose>& pose() const;
  const std::optional<client::Settings>& settings() const;
  client::VolumeStatus volume_status() const;
  const ViewVolume& volume() const;
  ViewVolume& volume();
  const PlotHistory& plots() const;
  // Of the newest pose; none over TCP, where clocks may differ.
  std::optional<double> stream_age_ms() const;
  std::uint64_t dropped_poses() const;
  // Since the newest pose came, where none has come for longer than kSilence although
  // palpated is connected: it hangs.
  static constexpr std::chrono::milliseconds kSilence{500};
  std::optional<double> silent_s() const;
  // Pose::time_ns of now, where plots end; 0 before the first pose.
  std::int64_t plots_end_ns() const;

  // Asked for in the background about once a second; none where there is none, or the
  // daemon is away.
  std::optional<client::DaemonInfo> device() const;
  std::optional<client::SeriesState> series() const;
  std::optional<client::RecordingState> recording() const;

  // Of what we are to palpated: kUnknown until it has said so.
  client::Role role() const;
  // False where our role is known to be a lesser one, and while disconnected.
  bool May(client::Role least) const;

  const Commands& commands() const;
  Commands& commands();
  // As commands().Do, for what changes series or recording: both are asked for again as
  // soon as it is done.
  void DoAndAsk(std::string name, std::function<void(client::Client&)> command);
  // Merged with what waits, key by key: of a slider that is moved the newest wins.
  void ControlSeries(const client::SeriesControl& control);
  Denoiser& denoiser();
  EmergencyStop& emergency_stop();
  const EmergencyStop& emergency_stop() const;

 private:
  struct Line;
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::view
