#include "client/cli/watch_command.h"

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/watch_statistics.h"
#include "client/cli/watch_view.h"
#include "client/program/interrupt.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kPoll(50);
constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kLivePeriodNs = kSecondNs / 10;
constexpr double kTextMessagesPerSecond = 31.25;
constexpr double kJsonMessagesPerSecond = 100.0;

// Reads CLOCK_MONOTONIC, the clock of the samples.
std::int64_t NowNs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecondNs + now.tv_nsec;
}

// Takes the samples. Also called between messages, so that the display shows the time.
class Sink {
 public:
  virtual ~Sink() = default;
  virtual void Take(const client::PoseBatch& batch) = 0;
  virtual void Refresh() {}
  virtual void End() {}
};

class JsonSink : public Sink {
 public:
  void Take(const client::PoseBatch& batch) override {
    std::string text;
    for (const client::Pose& pose : batch.poses) text += ToText(ToJson(pose));
    WriteOutput(text);
  }
};

// Relates a sample to its volume: to the range of its values, and to its place in the world.
class FeltVolume {
 public:
  explicit FeltVolume(client::Calls& palpated) : palpated_(palpated) {}

  void Relate(WatchStatus& status, std::int64_t now_ns) {
    const client::Pose& pose = *status.pose;
    // A new place of the volume is a change of settings; it is shown within a second.
    const bool is_other = pose.volume_revision != volume_.volume_revision ||
                          pose.settings_revision != settings_revision_;
    if (is_other && now_ns - fetched_ns_ > kSecondNs) {
      fetched_ns_ = now_ns;
      Fetch(pose);
    }
    status.normalized_isovalue.reset();
    status.scp_h_world_mm.reset();
    if (pose.volume_revision != volume_.volume_revision) return;
    const double range = volume_.value_max - volume_.value_min;
    if (range > 0.0) status.normalized_isovalue = (pose.isovalue - volume_.value_min) / range;
    status.scp_h_world_mm = X_WD_.Apply(pose.scp_h_mm);
  }

 private:
  void Fetch(const client::Pose& pose) {
    try {
      volume_ = palpated_.GetVolume();
      X_WD_ = volume_.world_from_index * volume_.device_from_index.Inverse();
      settings_revision_ = pose.settings_revision;
    } catch (const Error&) {
      // Ignored: this value is an extra of the view. The stream itself reports real trouble.
    }
  }

  client::Calls& palpated_;
  client::VolumeInfo volume_;
  AffineMap X_WD_;
  std::uint64_t settings_revision_ = 0;
  std::int64_t fetched_ns_ = -2 * kSecondNs;
};

double MaxForceN(client::Calls& palpated) {
  try {
    return palpated.GetDevice().device.max_force_n;
  } catch (const Error&) {
    return 0.0;  // no force bar
  }
}

class TextSink : public Sink {
 public:
  TextSink(client::Calls& palpated, double message_ms)
      : volume_(palpated),
        is_live_(IsTerminal(STDOUT_FILENO)),
        last_shown_ns_(NowNs()),
        statistics_(last_shown_ns_, palpated.shares_clock()) {
    status_.server = palpated.name();
    status_.age_is_exact = palpated.shares_clock();
    status_.max_force_n = MaxForceN(palpated);
    status_.old_after_ms += 2.0 * message_ms;
  }

  ~TextSink() override {
    if (shown_lines_ > 0) {
      // Not WriteOutput: it may throw.
      [[maybe_unused]] const auto written = write(STDOUT_FILENO, "\x1b[?25h", 6);
    }
  }

  void Take(const client::PoseBatch& batch) override {
    statistics_.Add(batch, NowNs());
    if (!batch.poses.empty()) status_.pose = batch.poses.back();
  }

  void Refresh() override {
    const std::int64_t now_ns = NowNs();
    if (now_ns - last_shown_ns_ < (is_live_ ? kLivePeriodNs : kSecondNs)) {
      return;
    }
    last_shown_ns_ = now_ns;
    if (status_.pose) volume_.Relate(status_, now_ns);
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
    // Move up to the start of the last view and clear from there. A line below the view holds the
    // cursor.
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

  FeltVolume volume_;
  const bool is_live_;
  std::int64_t last_shown_ns_;
  WatchStatistics statistics_;
  WatchStatus status_;
  std::size_t shown_lines_ = 0;
};

double RateOf(const WatchOptions& options) {
  return options.rate_hz.value_or(options.json ? 60.0 : 1000.0);
}

// Runs until the user ends it. Throws for any other end.
void Pump(client::Calls& palpated, const WatchOptions& options, Sink& sink) {
  const double rate_hz = RateOf(options);
  const std::int64_t start_ns = NowNs();
  client::PoseReader reader = palpated.ReadPoses(rate_hz, BatchFor(options, rate_hz));
  std::uint64_t left = options.count.value_or(UINT64_MAX);
  while (left > 0 && !Interrupt::IsRaised()) {
    const double seconds = static_cast<double>(NowNs() - start_ns) * 1e-9;
    if (options.seconds && seconds >= *options.seconds) {
      return;
    }
    if (std::optional<client::PoseBatch> batch = reader.Next(kPoll)) {
      if (batch->poses.size() > left) batch->poses.resize(left);
      left -= batch->poses.size();
      sink.Take(*batch);
    }
    sink.Refresh();
  }
}

void Watch(client::Calls& palpated, const WatchOptions& options) {
  const Interrupt interrupt;
  palpated.GetVolume();  // waits until there is something to feel
  std::unique_ptr<Sink> sink;
  if (options.json) {
    sink = std::make_unique<JsonSink>();
  } else {
    const double rate_hz = RateOf(options);
    sink = std::make_unique<TextSink>(palpated, 1e3 * BatchFor(options, rate_hz) / rate_hz);
  }
  try {
    Pump(palpated, options, *sink);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kUnavailable) {
      sink->End();
    }
    throw;
  }
  sink->End();
}

}  // namespace

void AddWatch(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "watch",
      "Watches the haptic loop: a live view on a terminal, else a line a second; then a summary.\n"
      "Positions are in the device frame: mm, x right, y up, z towards the user.\n"
      "Ctrl-C ends it, with exit code 0.");
  SetFooter(*command,
            "Examples: palpate watch --seconds 60 > log.txt\n"
            "          palpate watch --json --rate-hz 1000 --count 5000 > ticks.jsonl");
  const auto options = std::make_shared<WatchOptions>();
  command
      ->add_option("--rate-hz", options->rate_hz,
                   "Samples per second, above 0, up to 1000 [default: 1000, with --json 60]")
      ->check(arguments::Positive(1000.0));
  command->add_option("--count", options->count, "End after this many samples [default: none]")
      ->check(arguments::Positive());
  command->add_option("--seconds", options->seconds, "End after this time, s [default: none]")
      ->check(arguments::Positive());
  command->add_flag("--json", options->json, "One JSON object per sample and line, no summary");
  command->callback([&invocation, options] {
    invocation.command = [options](client::Calls& palpated) { Watch(palpated, *options); };
  });
}

std::uint32_t BatchFor(const WatchOptions& options, double rate_hz) {
  const double per_message =
      rate_hz / (options.json ? kJsonMessagesPerSecond : kTextMessagesPerSecond);
  const auto batch = static_cast<std::uint64_t>(std::clamp(std::ceil(per_message), 1.0, 256.0));
  return static_cast<std::uint32_t>(std::min(batch, options.count.value_or(batch)));
}

}  // namespace palpate::cli
