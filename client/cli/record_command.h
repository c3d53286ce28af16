// `palpate record ...`, `palpate mark` and `palpate replay`.
//
// Threads: main only.
// Errors: as Connection::Call and WriteOutput; kUnavailable where a recording ended
// early.
#pragma once

#include <optional>
#include <string>

#include "palpate/v1/recording.pb.h"

namespace palpate::cli {

class Connection;

struct RecordOptions {
  std::string path;  // relative to the working directory, or absolute
  bool overwrite = false;
  std::optional<double> seconds;
  bool json = false;
};

struct ReplayOptions {
  std::string path;
  double speed = 1.0;
};

// Records until the seconds are over or a signal comes; also where our output ends.
void RunRecording(const Connection& connection, const RecordOptions& options);

void StartRecording(const Connection& connection, const RecordOptions& options);
void StopRecording(const Connection& connection, bool json);
void ShowRecording(const Connection& connection, bool json);
void MarkRecording(const Connection& connection, const std::string& text);

// Prints markers as they pass. kCancelled after a signal.
void Replay(const Connection& connection, const ReplayOptions& options);

// Such as "60000 ticks (60.0 s), 0 lost, 6.2 MB, 103 bytes per tick, to /data/a.palrec".
// Pure.
std::string DescribeRecording(const v1::RecordingState& state);

}  // namespace palpate::cli
