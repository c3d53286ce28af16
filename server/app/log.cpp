#include "server/app/log.h"

#include <fmt/format.h>
#include <grpc/support/log.h>
#include <poll.h>
#include <spdlog/common.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/dup_filter_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <syslog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "common/error/error.h"
#include "server/log/log.h"

namespace palpate {
namespace {

// A reader may be busy for a short time.
constexpr int kPatienceMs = 200;

bool StderrTakesMore(int wait_ms) {
  pollfd stream{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  return poll(&stream, 1, wait_ms) == 1;
}

// Keeps a log that nobody reads from blocking the daemon. This sink stands in front of a sink that
// writes to stderr. While stderr takes nothing (a full pipe, a stopped terminal), this sink drops
// lines. Once stderr takes lines again, one line says how many were dropped.
//
// Lines must be shorter than PIPE_BUF: a pipe with room takes such a line at once.
class UnreadLog final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit UnreadLog(spdlog::sink_ptr to_stderr) : to_stderr_(std::move(to_stderr)) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (!StderrTakesMore(dropped_ == 0 ? kPatienceMs : 0)) {
      ++dropped_;
      return;
    }
    if (dropped_ > 0) {
      const std::string text = fmt::format("{} line{} of the log dropped: nobody read it", dropped_,
                                           dropped_ == 1 ? "" : "s");
      to_stderr_->log({message.logger_name, spdlog::level::warn, text});
      dropped_ = 0;
      if (!StderrTakesMore(0)) {
        dropped_ = 1;
        return;
      }
    }
    to_stderr_->log(message);
  }
  void flush_() override { to_stderr_->flush(); }
  void set_pattern_(const std::string& pattern) override { to_stderr_->set_pattern(pattern); }
  void set_formatter_(std::unique_ptr<spdlog::formatter> formatter) override {
    to_stderr_->set_formatter(std::move(formatter));
  }

 private:
  spdlog::sink_ptr to_stderr_;
  std::uint64_t dropped_ = 0;
};

constexpr std::chrono::seconds kRepeatsLeftOut{5};
constexpr std::size_t kLongestLine = 2000;  // as written; less than PIPE_BUF (see UnreadLog)

// Writes a prefix such as "<4>", from which the journal reads the level (here: warning).
class PriorityFlag final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    int priority = LOG_INFO;
    if (message.level <= spdlog::level::debug) priority = LOG_DEBUG;
    if (message.level == spdlog::level::warn) priority = LOG_WARNING;
    if (message.level == spdlog::level::err) priority = LOG_ERR;
    if (message.level == spdlog::level::critical) priority = LOG_CRIT;
    fmt::format_to(std::back_inserter(out), "<{}>", priority);
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PriorityFlag>();
  }
};

// Texts of clients and of files may hold any bytes. This flag escapes control characters, so that a
// text cannot break a line, imitate another line or control a terminal. It also cuts long texts.
class OneLineFlag final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    const std::string_view all(message.payload.data(), message.payload.size());
    const std::size_t end = out.size() + kLongestLine;
    for (const char c : all) {
      if (out.size() >= end) {
        fmt::format_to(std::back_inserter(out), " ...");
        return;
      }
      const auto byte = static_cast<unsigned char>(c);
      if (byte < 0x20 || byte == 0x7f) {
        fmt::format_to(std::back_inserter(out), "\\x{:02x}", byte);
      } else {
        out.push_back(c);
      }
    }
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<OneLineFlag>();
  }
};

// Any client can make gRPC log texts of its choice. Bytes that are not ASCII are replaced.
void LogOfGrpc(gpr_log_func_args* said) {
  std::string text = said->message;
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, '?');
  LogOfClient(said->severity == GPR_LOG_SEVERITY_ERROR ? LogLevel::kWarning : LogLevel::kDebug,
              "gRPC", "gRPC: {}", text);
}

}  // namespace

bool StderrIsJournal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat info {};
  if (stream == nullptr || fstat(STDERR_FILENO, &info) != 0) return false;
  return stream == std::to_string(info.st_dev) + ":" + std::to_string(info.st_ino);
}

void SetUpLog(bool to_journal) {
  gpr_set_log_function(LogOfGrpc);
  spdlog::sink_ptr sink;
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<OneLineFlag>('~');
  if (to_journal) {
    sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    formatter->add_flag<PriorityFlag>('*').set_pattern("%*%~");
  } else {
    sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
    formatter->set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %~");
  }
  const auto filter = std::make_shared<spdlog::sinks::dup_filter_sink_mt>(kRepeatsLeftOut);
  filter->add_sink(std::make_shared<UnreadLog>(std::move(sink)));
  const auto logger = std::make_shared<spdlog::logger>("palpated", filter);
  logger->set_formatter(std::move(formatter));
  logger->flush_on(spdlog::level::trace);
  // One owner is never destroyed: gRPC's threads may outlive main, and log.
  [[maybe_unused]] static auto& kept = *new std::shared_ptr<spdlog::logger>(logger);
  spdlog::set_default_logger(logger);
}

void CheckLogLevel(const std::string& name) {
  if (std::find(kLogLevels.begin(), kLogLevels.end(), name) != kLogLevels.end()) return;
  throw Error(ErrorKind::kInvalidArgument, "must be \"debug\", \"info\", \"warning\" or \"error\"");
}

void SetLogLevel(const std::string& name) {
  CheckLogLevel(name);
  spdlog::set_level(spdlog::level::from_str(name));
}

}  // namespace palpate
