#include "client/cli/download_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>

#include "client/cli/connection.h"
#include "client/cli/nrrd_writer.h"
#include "client/cli/output.h"
#include "client/interrupt/interrupt.h"
#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kInterruptPoll(50);
constexpr int kMostLosses = 5;

// On a terminal a line in place; else one per quarter.
class Progress {
 public:
  ~Progress() {
    if (drawn_) std::fputs("\r\x1b[K", stderr);
  }

  void Show(const VolumeMirror& mirror) {
    most_left_ = std::max(most_left_, mirror.bricks_left());
    if (most_left_ == 0) return;
    const int percent = static_cast<int>(100 - 100 * mirror.bricks_left() / most_left_);
    if (is_terminal_ ? percent == shown_ : percent / 25 == shown_ / 25 && shown_ >= 0) return;
    shown_ = percent;
    drawn_ = is_terminal_;
    fmt::print(stderr, "{}{:3} % of {} bricks{}", is_terminal_ ? "\r\x1b[K" : "", percent,
               most_left_, is_terminal_ ? "" : "\n");
  }

 private:
  const bool is_terminal_ = IsTerminal(STDERR_FILENO);
  std::uint64_t most_left_ = 0;
  int shown_ = -1;
  bool drawn_ = false;
};

void CheckInterrupt() {
  if (Interrupt::IsRaised()) {
    throw Error(ErrorKind::kCancelled, "the download was cancelled; no file was written");
  }
}

void Fetch(VolumeReader& reader, const VolumeMirror& mirror) {
  Progress progress;
  while (true) {
    const VolumeReader::Event event = reader.Next(kInterruptPoll);
    CheckInterrupt();
    switch (event) {
      case VolumeReader::Event::kComplete:
        return;
      case VolumeReader::Event::kLost:
        if (reader.losses_in_a_row() >= kMostLosses) throw Error(*reader.last_loss());
        break;
      case VolumeReader::Event::kApplied:
        progress.Show(mirror);
        break;
      case VolumeReader::Event::kTimeout:
        break;
    }
  }
}

}  // namespace

void Download(const Connection& connection, const DownloadOptions& options) {
  const Interrupt interrupt;
  // Before the volume travels.
  CheckNrrdPath(options.file, options.overwrite);
  const auto begin = std::chrono::steady_clock::now();
  VolumeMirror mirror;
  VolumeReader reader(connection.channel(), mirror);
  Fetch(reader, mirror);
  const std::chrono::duration<double> took_s = std::chrono::steady_clock::now() - begin;
  WriteNrrd(mirror, options.file, options.overwrite, [] { CheckInterrupt(); });
  const Vec3i& size = mirror.lattice()->size;
  WriteOutput(fmt::format(
      "{}: {} x {} x {} voxels of {} at volume revision {}; {:.1f} MB received in {:.2f} s\n",
      OneLine(options.file), size.x(), size.y(), size.z(), OneLine(mirror.lattice()->source),
      mirror.resume()->volume_revision, static_cast<double>(reader.bytes_received()) * 1e-6,
      took_s.count()));
}

}  // namespace palpate::cli
