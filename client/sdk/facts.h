// What is true of the daemon now, besides poses and voxels. facts.proto explains the fields.
//
// Threads: plain values.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "client/sdk/activity.h"
#include "client/sdk/device.h"
#include "client/sdk/recording.h"
#include "client/sdk/series.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"
#include "common/contract/volume_stream.h"

namespace palpate::client {

using palpate::CallerDescription;
using palpate::Hand;
using palpate::HandsState;

// The newest of each; none: not told yet. All are of one connection.
struct Facts {
  std::string problem{};  // why palpated tells none; empty: it does
  std::optional<Settings> settings{};
  std::optional<VolumeInfo> volume{};
  std::optional<VolumePlacement> placement{};
  std::optional<SeriesState> series{};  // none also if no series is loaded
  std::optional<RecordingState> recording{};
  std::optional<HandsState> hands{};
  std::optional<Activity> activity{};
  std::chrono::steady_clock::time_point activity_came{};  // its times are as of then
  CallerDescription caller{};                             // we
  // The same facts as bytes of palpate.v1.Facts, for programs that relay them.
  std::string message{};
};

}  // namespace palpate::client
