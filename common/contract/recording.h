// Written by proto/generate from palpate/v1/recording.proto: change that.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace palpate {

// What viewers get in place of the live ticks. Forces are off meanwhile.
struct RunningReplay {
  // Who replays, and from where: "token or-2 at ipv4:192.0.2.7:51544".
  std::string by{};
  // Absolute path on the daemon's machine.
  std::string path{};
  // Ticks played so far, with the one that is shown, and those before the first one shown.
  std::uint64_t ticks = 0;
  // Ticks of the whole recording.
  std::uint64_t total_ticks = 0;
  // Multiple of real time. Viewers pause with a speed below 1e-6.
  double speed = 0.0;
  friend bool operator==(const RunningReplay&, const RunningReplay&) = default;
};
template <class Visit>
void VisitFields(const RunningReplay& value, Visit&& visit) {
  visit("by", value.by);
  visit("path", value.path);
  visit("ticks", value.ticks);
  visit("total_ticks", value.total_ticks);
  visit("speed", value.speed);
}
template <class Visit>
void VisitFields(RunningReplay& value, Visit&& visit) {
  visit("by", value.by);
  visit("path", value.path);
  visit("ticks", value.ticks);
  visit("total_ticks", value.total_ticks);
  visit("speed", value.speed);
}

struct RecordedMarker {
  // The marker's tick, counted from the recording's first one: the last one that began at or
  // before the time of the marker.
  std::uint64_t tick = 0;
  std::string text{};
  friend bool operator==(const RecordedMarker&, const RecordedMarker&) = default;
};
template <class Visit>
void VisitFields(const RecordedMarker& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("text", value.text);
}
template <class Visit>
void VisitFields(RecordedMarker& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("text", value.text);
}

struct RecordedFile {
  // Absolute path on the daemon's machine.
  std::string path{};
  std::uint64_t size_bytes = 0;
  // Seconds since 1970, UTC.
  std::int64_t modified_s = 0;
  friend bool operator==(const RecordedFile&, const RecordedFile&) = default;
};
template <class Visit>
void VisitFields(const RecordedFile& value, Visit&& visit) {
  visit("path", value.path);
  visit("size_bytes", value.size_bytes);
  visit("modified_s", value.modified_s);
}
template <class Visit>
void VisitFields(RecordedFile& value, Visit&& visit) {
  visit("path", value.path);
  visit("size_bytes", value.size_bytes);
  visit("modified_s", value.modified_s);
}

// The present recording, or the last one.
struct RecordingState {
  // A recording is being made now.
  bool running = false;
  // Of the file on the daemon's machine; empty: nothing was recorded yet.
  std::string path{};
  // Ticks recorded so far.
  std::uint64_t ticks = 0;
  // Ticks lost because the disk was too slow.
  std::uint64_t lost_ticks = 0;
  // Size of the file so far.
  std::uint64_t size_bytes = 0;
  // Why the recording ended early; empty: it did not.
  std::string error{};
  // Why some ticks cannot be computed again (palpate-lab replay): more than 64 MiB of voxels
  // were not stored and cannot be loaded from a file. Empty: all ticks can be computed.
  std::string left_out{};
  // The replay that runs now; absent: viewers get the live ticks.
  std::optional<RunningReplay> replay{};
  // The disk is full, or a quota is used up.
  bool disk_full = false;
  friend bool operator==(const RecordingState&, const RecordingState&) = default;
};
template <class Visit>
void VisitFields(const RecordingState& value, Visit&& visit) {
  visit("running", value.running);
  visit("path", value.path);
  visit("ticks", value.ticks);
  visit("lost_ticks", value.lost_ticks);
  visit("size_bytes", value.size_bytes);
  visit("error", value.error);
  visit("left_out", value.left_out);
  visit("replay", value.replay);
  visit("disk_full", value.disk_full);
}
template <class Visit>
void VisitFields(RecordingState& value, Visit&& visit) {
  visit("running", value.running);
  visit("path", value.path);
  visit("ticks", value.ticks);
  visit("lost_ticks", value.lost_ticks);
  visit("size_bytes", value.size_bytes);
  visit("error", value.error);
  visit("left_out", value.left_out);
  visit("replay", value.replay);
  visit("disk_full", value.disk_full);
}

struct ReplayResponse {
  // Ticks played so far, with the one that is shown, and those before first_tick.
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;
  // Text of the marker just passed; empty: none.
  std::string marker{};
  // Ticks of the whole recording.
  std::uint64_t total_ticks = 0;
  // All markers of the recording, up to 1 MiB of their texts; with the first response only.
  std::vector<RecordedMarker> markers{};
  friend bool operator==(const ReplayResponse&, const ReplayResponse&) = default;
};
template <class Visit>
void VisitFields(const ReplayResponse& value, Visit&& visit) {
  visit("ticks", value.ticks);
  visit("lost_ticks", value.lost_ticks);
  visit("marker", value.marker);
  visit("total_ticks", value.total_ticks);
  visit("markers", value.markers);
}
template <class Visit>
void VisitFields(ReplayResponse& value, Visit&& visit) {
  visit("ticks", value.ticks);
  visit("lost_ticks", value.lost_ticks);
  visit("marker", value.marker);
  visit("total_ticks", value.total_ticks);
  visit("markers", value.markers);
}

struct ListRecordingsResponse {
  // Newest first.
  std::vector<RecordedFile> recordings{};
  // Where new recordings belong: the first folder that the daemon saves to. Empty: it saves
  // nowhere.
  std::string folder{};
  friend bool operator==(const ListRecordingsResponse&, const ListRecordingsResponse&) = default;
};
template <class Visit>
void VisitFields(const ListRecordingsResponse& value, Visit&& visit) {
  visit("recordings", value.recordings);
  visit("folder", value.folder);
}
template <class Visit>
void VisitFields(ListRecordingsResponse& value, Visit&& visit) {
  visit("recordings", value.recordings);
  visit("folder", value.folder);
}

}  // namespace palpate
