#include "client/cli/watch_command.h"

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "client/cli/connection.h"
#include "client/cli/output.h"
#include "client/cli/pose_stream.h"
#include "client/cli/sample_json.h"
#include "client/cli/watch_statistics.h"
#include "client/cli/watch_view.h"
#include "client/interrupt/interrupt.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kPoll(50);
constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kLivePeriodNs = kSecondNs / 10;
constexpr double kTextMessagesPerSecond = 31.25;
constexpr double kJsonMessagesPerSecond = 100.0;

// CLOCK_MONOTONIC, the clock of the samples.
std::int64_t NowNs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecondNs + now.tv_nsec;
}

// Takes the stream in; called between messages too, so that time shows.
class Sink {
 public:
  virtual ~Sink() = default;
  // The first `count` samples of a message.
  virtual void Take(const v1::StreamPosesResponse& message, int count) = 0;
  virtual void Refresh() {}
  virtual void End() {}
};

class JsonSink : public Sink {
 public:
  void Take(const v1::StreamPosesResponse& message, int count) override {
    std::string text;
    for (int i = 0; i < count; ++i) {
      text += ToText(ToJson(message.samples(i)));
    }
    WriteOutput(text);
  }
};

// The isovalue of a sample over the range of its volume, as far as it is known.
class Normalizer {
 public:
  explicit Normalizer(const Connection& connection) : connection_(connection) {}

  std::optional<double> Normalize(const v1::PoseSample& sample, std::int64_t now_ns) {
    if (sample.volume_revision() != volume_.volume_revision() && now_ns - fetched_ns_ > kSecondNs) {
      fetched_ns_ = now_ns;
      Fetch();
    }
    const double range = volume_.value_max() - volume_.value_min();
    if (sample.volume_revision() != volume_.volume_revision() || !(range > 0.0)) {
      return std::nullopt;
    }
    return (sample.isovalue() - volume_.value_min()) / range;
  }

 private:
  void Fetch() {
    try {
      volume_ = connection_
                    .Call(*v1::VolumeService::NewStub(connection_.channel()),
                          &v1::VolumeService::Stub::GetVolume, v1::GetVolumeRequest())
                    .volume();
    } catch (const Error&) {
      // An extra in the view; the stream itself tells of real trouble.
    }
  }

  const Connection& connection_;
  v1::VolumeDescription volume_;
  std::int64_t fetched_ns_ = -2 * kSecondNs;
};

double MaxForceN(const Connection& connection) {
  try {
    return connection
        .Call(*v1::DeviceService::NewStub(connection.channel()),
              &v1::DeviceService::Stub::GetDevice, v1::GetDeviceRequest())
        .device()
        .max_force_n();
  } catch (const Error&) {
    return 0.0;  // no bar
  }
}

class TextSink : public Sink {
 public:
  explicit TextSink(const Connection& connection)
      : normalizer_(connection),
        is_live_(IsTerminal(STDOUT_FILENO)),
        last_shown_ns_(NowNs()),
        statistics_(last_shown_ns_, connection.shares_clock()) {
    status_.server = connection.name();
    status_.age_is_exact = connection.shares_clock();
    status_.max_force_n = MaxForceN(connection);
  }

  ~TextSink() override {
    if (shown_lines_ > 0) {
      // Not WriteOutput, which may throw.
      [[maybe_unused]] const auto written = write(STDOUT_FILENO, "\x1b[?25h", 6);
    }
  }

  void Take(const v1::StreamPosesResponse& message, int count) override {
    statistics_.Add(message, count, NowNs());
    if (count > 0) {
      status_.sample = message.samples(count - 1);
    }
  }

  void Refresh() override {
    const std::int64_t now_ns = NowNs();
    if (now_ns - last_shown_ns_ < (is_live_ ? kLivePeriodNs : kSecondNs)) {
      return;
    }
    last_shown_ns_ = now_ns;
    if (status_.sample) {
      status_.normalized_isovalue = normalizer_.Normalize(*status_.sample, now_ns);
    }
    status_.figures = statistics_.Figures(now_ns);
    if (is_live_) {
      ShowLive();
    } else {
      WriteOutput(LogLine(status_) + "\n");
    }
  }

  void End() override { WriteOutput(Summary(statistics_.Figures(NowNs()))); }

 private:
  void ShowLive() {
    const TerminalSize size = SizeOfTerminal(STDOUT_FILENO);
    // Up to where the last view began, and clear from there; a line below the
    // view holds the cursor.
    std::string text = "\x1b[?25l\r";
    if (shown_lines_ > 0) {
      text += "\x1b[" + std::to_string(shown_lines_) + "A";
    }
    text += "\x1b[J";
    const std::vector<std::string> lines = LiveView(status_, size.columns - 1, size.rows - 1);
    for (const std::string& line : lines) {
      text += line + "\n";
    }
    shown_lines_ = lines.size();
    WriteOutput(text);
  }

  Normalizer normalizer_;
  const bool is_live_;
  std::int64_t last_shown_ns_;
  WatchStatistics statistics_;
  WatchStatus status_;
  std::size_t shown_lines_ = 0;
};

// Runs until an end that was asked for; throws on any other.
void Pump(const Connection& connection, const WatchOptions& options, Sink& sink) {
  const double rate_hz = options.rate_hz.value_or(options.json ? 60.0 : 1000.0);
  const std::int64_t start_ns = NowNs();
  PoseStream stream(connection, rate_hz, BatchFor(options, rate_hz));
  std::uint64_t left = options.count.value_or(UINT64_MAX);
  v1::StreamPosesResponse message;
  while (left > 0 && !Interrupt::IsRaised()) {
    const double seconds = static_cast<double>(NowNs() - start_ns) * 1e-9;
    if (options.seconds && seconds >= *options.seconds) {
      return;
    }
    const CallEvent event = stream.Next(kPoll, message);
    if (event == CallEvent::kEnded) {
      throw connection.ErrorOfEnd(stream.status());
    }
    if (event == CallEvent::kMessage) {
      const auto samples = static_cast<std::uint64_t>(message.samples_size());
      const std::uint64_t count = std::min(samples, left);
      left -= count;
      sink.Take(message, static_cast<int>(count));
    }
    sink.Refresh();
  }
}

}  // namespace

void Watch(const Connection& connection, const WatchOptions& options) {
  const Interrupt interrupt;
  std::unique_ptr<Sink> sink;
  if (options.json) {
    sink = std::make_unique<JsonSink>();
  } else {
    sink = std::make_unique<TextSink>(connection);
  }
  try {
    Pump(connection, options, *sink);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kUnavailable) {
      sink->End();
    }
    throw;
  }
  sink->End();
}

std::uint32_t BatchFor(const WatchOptions& options, double rate_hz) {
  const double per_message =
      rate_hz / (options.json ? kJsonMessagesPerSecond : kTextMessagesPerSecond);
  const auto batch = static_cast<std::uint64_t>(std::clamp(std::ceil(per_message), 1.0, 256.0));
  return static_cast<std::uint32_t>(std::min(batch, options.count.value_or(batch)));
}

}  // namespace palpate::cli
